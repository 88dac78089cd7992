"""Files of a finished map: damaged, or crafted so that their stage's record fits them."""

import io
import json
import os
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from attacks.attempt import Attempt, anything, less, same
from attacks.ground import replace, seal_anew, sealed
from attacks.mutations import spoilt, spoilt_text, word
from vnav.io.store.map_folder import STAGES

Random = np.random.Generator
QUICK = ("--set", "locate.max_features=800")
LOCATE = ("locate", "photos/000.jpg", "--map", "map", "--json", *QUICK)
PLAN = ("plan", "--map", "map", "--from", "1,1", "--to", "2,2", "--json")
PARTS = ("trajectory:tum", "trajectory:kitti", "cloud:ply", "octomap:bt", "octomap:ot")
PARTS += ("grid:pgm", "mesh:ply", "mesh:obj", "graph:g2o")
COMMANDS = (
    LOCATE,
    LOCATE,
    ("locate", "photos/001.jpg", "photos/002.jpg", "--map", "map", "--json", *QUICK),
    PLAN,
    ("plan", "--map", "map", "--from", "current", "--to", "2,2", "--json"),
    ("info", "map", "--json"),
    ("info", "map"),
    ("config", "map"),
    ("report", "map"),
    *(("export", "map", "--out", "out", f"--{p}", f) for p, f in (x.split(":") for x in PARTS)),
)
SLOW = tuple((stage, "--map", "map", "--set", "seed=1") for stage in STAGES[1:])  # made anew
SLOW_SHARE = 0.06
READ_BY = {  # the files of these stages are read by the commands
    "odometry": (LOCATE, ("info", "map", "--json"), ("report", "map")),
    "vocabulary": (LOCATE,),
    "loops": (("info", "map", "--json"), ("report", "map")),
    "optimise": (LOCATE, ("info", "map", "--json"), COMMANDS[9], ("report", "map")),
    "fuse": (SLOW[-1], PLAN, ("info", "map", "--json"), COMMANDS[11], COMMANDS[16]),
    "index": (LOCATE,),
}


def attempt(rng: Random, folder: Path) -> Attempt:
    """A map that is no longer what vnav wrote, and a command that asks it."""
    how = (damage, damage, craft_table, craft_table, craft_json, craft_file, misplace)
    what, stage, judge = how[rng.integers(len(how))](rng, folder / "map")
    command = chosen(rng, stage)
    if judge is same and command[0] in ("info", "config"):
        judge = less
    outputs = ("out", f"map/{command[0]}") if command in SLOW else ("out",)
    return Attempt(f"{what}; {' '.join(command)}", command, judge, outputs=outputs)


def chosen(rng: Random, stage: str) -> tuple[str, ...]:
    """A command: one that reads the stage more often than any other."""
    if rng.random() < SLOW_SHARE:
        return SLOW[rng.integers(len(SLOW))]
    commands: Sequence[tuple[str, ...]] = COMMANDS
    if stage in READ_BY and rng.random() < 0.7:
        commands = READ_BY[stage]
    return commands[rng.integers(len(commands))]


Done = tuple[str, str, Callable[..., str]]  # what was done, to which stage, how it is judged


def damage(rng: Random, root: Path) -> Done:
    """A file is not what its stage wrote."""
    path = any_file(rng, root)
    how, content = spoilt(path.read_bytes(), rng)
    replace(path, content)
    return f"{how} of {path.relative_to(root)}", path.parent.name, same


def misplace(rng: Random, root: Path) -> Done:
    """A file is missing, something else than a file, another one, or huge."""
    path, other = any_file(rng, root), any_file(rng, root)
    content = other.read_bytes()
    changes: dict[str, Callable[[], Any]] = {
        "removed": lambda: None,
        "a folder": path.mkdir,
        "a pipe": lambda: os.mkfifo(path),
        "a link to nothing": lambda: path.symlink_to("nothing"),
        "a link to itself": lambda: path.symlink_to(path.name),
        "a link to /dev/zero": lambda: path.symlink_to("/dev/zero"),
        f"the content of {other.relative_to(root)}": lambda: path.write_bytes(content),
        "empty": path.touch,
        "8 GB of nothing": lambda: (path.touch(), os.truncate(path, 2**33)),
    }
    how = list(changes)[rng.integers(len(changes))]
    path.unlink()
    changes[how]()
    return f"{path.relative_to(root)} is {how}", path.parent.name, same


def craft_table(rng: Random, root: Path) -> Done:
    """An array of a table is another, and its stage's record fits it."""
    path = drawn(rng, sorted(root.glob("*/*.npz")))
    with np.load(path) as file:
        arrays = dict(file)
    name = drawn(rng, list(arrays))
    how, changed = other_array(arrays[name], rng)
    arrays = {key: changed if key == name else values for key, values in arrays.items()}
    if how == "removed":
        del arrays[name]
    if how == "planted":
        arrays["planted"] = changed
    content = io.BytesIO()
    np.savez(content, **arrays)
    replace(path, content.getvalue())
    seal_anew(root, path.parent.name)
    judge = same if how in STRUCTURAL else anything
    return f"{name} of {path.relative_to(root)}: {how}", path.parent.name, judge


STRUCTURAL = ("as text", "as complex numbers", "a dimension more", "removed", "planted")


def other_array(values: Any, rng: Random) -> tuple[str, Any]:
    """What was done to an array, and what it is then."""
    flat = values.copy().reshape(-1)
    at = rng.integers(max(1, flat.size), size=rng.integers(1, 4)) if flat.size else []
    whole = np.issubdtype(values.dtype, np.integer)
    numbers = [-1, 0, 10**6, 2**31 - 1, -(2**31)] if whole else [np.nan, np.inf, -1, 0, 1e30, 1e300]
    number = drawn(rng, numbers)
    wide = flat.astype(np.int64 if whole else values.dtype)
    with np.errstate(all="ignore"):
        wide[at] = np.array(number).astype(wide.dtype)
        everywhere = np.full(values.shape, number).astype(wide.dtype)
    changes = {
        "as text": lambda: values.astype(str),
        "as complex numbers": lambda: values.astype(complex),
        "a dimension more": lambda: values[None],
        "removed": lambda: values,
        "planted": lambda: values,
        f"{number} at some places": lambda: wide.reshape(values.shape),
        f"{number} everywhere": lambda: everywhere,
        "a row less": lambda: values[:-1] if values.ndim else values,
        "a row more": lambda: np.concatenate([values, values[-1:]]) if values.ndim else values,
        "no rows": lambda: values[:0] if values.ndim else values,
        "shuffled": lambda: rng.permutation(values) if values.ndim else values,
        "single precision": lambda: values.astype(np.float32),
    }
    how = drawn(rng, list(changes))
    return how, changes[how]()


def craft_json(rng: Random, root: Path) -> Done:
    """A JSON file says something else, under a seal that fits."""
    names = ["map.json", "odometry/lost.json", "loops/verdicts.json", "optimise/world.json"]
    names += ["optimise/verdicts.json", "reports/quality.json", "state/current.json"]
    names += [f"{stage}/stage.json" for stage in STAGES]
    path = root / drawn(rng, names)
    values = json.loads(path.read_text("utf-8"))
    is_sealed = isinstance(values, dict) and values.pop("sha256", None) is not None
    how = other_json(values, rng)
    try:
        replace(path, sealed(values) if is_sealed else json.dumps(values).encode())
    except ValueError:  # vnav's own JSON holds no NaN
        replace(path, json.dumps(values).encode())
    if not is_sealed:
        seal_anew(root, path.parent.name)
    return f"{path.relative_to(root)}: {how}", path.parent.name, anything


def other_json(values: Any, rng: Random) -> str:
    """Change something in a JSON value; what it was."""
    inner = values
    while isinstance(inner, dict | list) and inner:
        keys = list(inner) if isinstance(inner, dict) else range(len(inner))
        key = keys[rng.integers(len(keys))]
        if not isinstance(inner[key], dict | list) or not inner[key] or rng.random() < 0.3:
            break
        inner = inner[key]
    if not isinstance(inner, dict | list) or not inner:
        return "nothing, for it is empty"
    wrong = (None, True, -1, 0, 10**400, 1e308, float("nan"), "x", "../..", word(rng), [], {}, [{}])
    wrong += (nested(50), 0.5, 2**63, {"id": 0}, "odometry")
    ways = {
        "removed": lambda: inner.pop(key),
        "another value": lambda: inner.__setitem__(key, wrong[rng.integers(len(wrong))]),
        "another key": lambda: inner.update(planted=1) if isinstance(inner, dict) else None,
    }
    how = drawn(rng, ["removed", "another value", "another value", "another key"])
    ways[how]()
    return f"{how} at {key}"


def nested(depth: int) -> Any:
    value: Any = 1
    for _ in range(depth):
        value = [value]
    return value


def craft_file(rng: Random, root: Path) -> Done:
    """A file that is no table is spoilt, and its stage's record fits it."""
    files = [p for p in root.glob("*/*") if p.suffix in (".ply", ".tum", ".pgm", ".yaml", ".g2o")]
    files += [*root.glob("fuse/occupancy.*"), *root.glob("odometry/*.npz")]
    files += [drawn(rng, sorted(root.glob("odometry/keyframes/*")))]
    path = drawn(rng, sorted(files))
    is_text = path.suffix in (".tum", ".yaml", ".g2o")
    how, content = (spoilt_text if is_text else spoilt)(path.read_bytes(), rng)
    replace(path, content)
    stage = path.relative_to(root).parts[0]
    seal_anew(root, stage)
    return f"{how} of {path.relative_to(root)}, sealed anew", stage, anything


def any_file(rng: Random, root: Path) -> Path:
    """A file of a map; keyframes, which are many, are one of each stage's files."""
    stage = drawn(rng, [*STAGES, "", "state", "reports"])
    files = [p for p in (root / stage).glob("*") if p.is_file()]
    files += [drawn(rng, sorted(root.glob("odometry/keyframes/*")))] if stage == STAGES[0] else []
    return drawn(rng, sorted(files))


def drawn(rng: Random, values: Sequence[Any]) -> Any:
    """One of several values."""
    return values[rng.integers(len(values))]
