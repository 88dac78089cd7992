"""ROS camera_info: what camera_calibration writes (ost.yaml), and a CameraInfo message in YAML.

Depth images of ROS are millimetres (REP 118). A small part of YAML is read, the part that these
writers use: ``key: value``, lists in brackets or with a dash a line.

Source: https://docs.ros.org/en/noetic/api/sensor_msgs/html/msg/CameraInfo.html;
camera_calibration_parsers (parse_yml.cpp); https://www.ros.org/reps/rep-0118.html.
"""

import re
from collections.abc import Mapping
from typing import Any

from vnav.io.cameras.tables import Tables, brown_conrady, pinhole

NAME = "ROS camera_info"
FILES: tuple[str, ...] = ("camera_info.yaml", "camera_info.yml", "ost.yaml")

_UNITS_PER_METRE = 1000.0
_MODELS = ("plumb_bob", "rational_polynomial")
_K = ("camera_matrix.data", "K", "k")  # of camera_calibration, of ROS 1, of ROS 2
_D = ("distortion_coefficients.data", "D", "d")
_WIDTH, _HEIGHT = ("image_width", "width"), ("image_height", "height")
_IN_BRACKETS = re.compile(r"\[[^\[\]]*\]")
_LINE = re.compile(r"( *)(?:([\w./]+):|-)(?: +(.*))?")

Values = Mapping[str, Any]  # by path, such as camera_matrix.data


def recognises(content: Any) -> bool:
    """Whether it has a calibration matrix and a size under their names."""
    if not isinstance(content, dict) or _first(content, _K) is None:
        return False
    return _first(content, _WIDTH) is not None


def tables(content: Any) -> Tables:
    """The colour camera as it is before rectification; ValueError for another distortion model."""
    coefficients = _first(content, _D) or []
    model = content.get("distortion_model") or _MODELS[0]
    if model not in _MODELS or not isinstance(coefficients, list):
        raise ValueError(
            f"expected a distortion_model of {' or '.join(_MODELS)} with its coefficients, found"
            f" {model} with {coefficients}; rectify the images with image_proc, and give the camera"
            " of what results"
        )
    color = pinhole(_first(content, _K)) | {
        "width": _first(content, _WIDTH),
        "height": _first(content, _HEIGHT),
        "distortion": brown_conrady(coefficients, model),
    }
    return {"color": color, "depth": {"units_per_metre": _UNITS_PER_METRE}}


def _first(content: Values, keys: tuple[str, ...]) -> Any:
    return next((content[key] for key in keys if key in content), None)


def read_yaml(text: str) -> dict[str, Any]:
    """Numbers, words and lists by their path; ValueError names the line that is none of these.

    Of several documents the first is read; one key that holds all others is left out of the paths.
    """
    values: dict[str, Any] = {}
    above: list[tuple[int, str]] = []  # the keys that the line stands below, by their indentation
    for line in _lines(text):
        match = _LINE.fullmatch(line)
        if match is None:
            raise ValueError(f"a line that is neither 'key: value' nor '- value': {line.strip()}")
        indent, key, value = len(match[1]), match[2], _value(match[3])
        while above and (above[-1][0] > indent or key and above[-1][0] == indent):
            above.pop()
        path = ".".join([*(name for _, name in above), *([key] if key else [])])
        if key is not None:
            values[path] = value
            above.append((indent, key))
        elif isinstance(values.get(path), list):
            values[path].append(value)
        else:
            values[path] = [value]
    return _below_the_only(values)


def _lines(text: str) -> list[str]:
    """The first document without comments, each list in brackets in one line."""
    joined = _IN_BRACKETS.sub(lambda match: " ".join(match[0].split()), text)
    lines = [re.sub(r"(^|\s)#.*", "", line).rstrip() for line in joined.splitlines()]
    lines = [line for line in lines if line and not line.startswith("%")]
    starts = [k for k, line in enumerate(lines) if line.startswith(("---", "..."))]
    first = starts[0] + 1 if starts and starts[0] == 0 else 0
    end = next((k for k in starts if k >= first), len(lines))
    return lines[first:end]


def _value(text: str | None) -> Any:
    """A list, a number or a word; None where nothing is written."""
    if text is None or not text.strip():
        return None
    text = text.strip()
    if text.startswith("[") and text.endswith("]"):
        return [_value(word) for word in text[1:-1].split(",") if word.strip()]
    for kind in (int, float):
        try:
            return kind(text)
        except ValueError:
            pass
    return text.strip("'\"")


def _below_the_only(values: dict[str, Any]) -> dict[str, Any]:
    """Without the key that all others stand below, as where a message is stored as one field."""
    first = next(iter(values), "")
    inside = {key: value for key, value in values.items() if key != first}
    if inside and values[first] is None and all(key.startswith(f"{first}.") for key in inside):
        return {key.removeprefix(f"{first}."): value for key, value in inside.items()}
    return values
