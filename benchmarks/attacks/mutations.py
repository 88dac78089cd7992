"""Bytes and texts made worse, as a random generator draws it."""

import re
from collections.abc import Callable

import numpy as np

Bytes = Callable[[bytes, np.random.Generator], bytes]
WORDS = (
    *("nan", "inf", "-inf", "1e308", "-1e308", "1e-320", "-1", "0", "-0", "9" * 400, "1e999"),
    *("", "x", "0x10", "1_000", "2**31", "4294967296", "-9223372036854775809", "true", "null"),
    *("\0", "\x1b[2J", "\ufeff", "../../../etc/passwd", "/dev/zero", "n" * 300, "\N{SNOWMAN}"),
    *("[" * 5000, "{" * 5000, '"', "'", "#", "=", "\r", "1e5", "16777217", "1.5", "{}", "[]"),
)
NUMBER = re.compile(r"[-+]?\d+(\.\d+)?([eE][-+]?\d+)?")
EXTREMES = (
    b"\0\0\0\0",
    b"\xff\xff\xff\xff",
    b"\x7f\xff\xff\xff",
    b"\xff\xff\xff\x7f",
    b"\x80\0\0\0",
)


def word(rng: np.random.Generator) -> str:
    """A word that no reader wants."""
    return WORDS[rng.integers(len(WORDS))]


def cut(data: bytes, rng: np.random.Generator) -> bytes:
    """Without its end."""
    return data[: rng.integers(max(1, len(data)))]


def flip(data: bytes, rng: np.random.Generator) -> bytes:
    """Up to 16 bytes are others."""
    changed = bytearray(data)
    for at in rng.integers(len(data), size=rng.integers(1, 17)) if data else ():
        changed[at] ^= int(rng.integers(1, 256))
    return bytes(changed)


def flip_head(data: bytes, rng: np.random.Generator) -> bytes:
    """The same in the first 200 bytes, where sizes and types stand."""
    return flip(data[:200], rng) + data[200:]


def extreme(data: bytes, rng: np.random.Generator) -> bytes:
    """A number of four bytes at its limit, near to the beginning as a rule."""
    at = int(rng.integers(max(1, min(len(data), 10 ** int(rng.integers(1, 6))))))
    return data[:at] + EXTREMES[rng.integers(len(EXTREMES))] + data[at + 4 :]


def insert(data: bytes, rng: np.random.Generator) -> bytes:
    """With foreign bytes in it."""
    at = int(rng.integers(len(data) + 1))
    return data[:at] + rng.bytes(int(rng.integers(1, 64))) + data[at:]


def repeat(data: bytes, rng: np.random.Generator) -> bytes:
    """A part comes twice."""
    begin, end = sorted(rng.integers(len(data) + 1, size=2))
    return data[:end] + data[begin:end][:100_000] + data[end:]


def noise(data: bytes, rng: np.random.Generator) -> bytes:
    """Nothing of it is left."""
    return rng.bytes(int(rng.integers(0, 2000)))


BINARY: tuple[Bytes, ...] = (cut, flip, flip, flip_head, extreme, insert, repeat, noise)


def spoilt(data: bytes, rng: np.random.Generator) -> tuple[str, bytes]:
    """What was done to bytes, and what they are then."""
    how = BINARY[rng.integers(len(BINARY))]
    return how.__name__, how(data, rng)


def other_number(text: str, rng: np.random.Generator) -> str:
    """One number of a text is another word."""
    numbers = list(NUMBER.finditer(text))
    if not numbers:
        return text + word(rng)
    found = numbers[rng.integers(len(numbers))]
    return text[: found.start()] + word(rng) + text[found.end() :]


def other_line(text: str, rng: np.random.Generator) -> str:
    """A line is missing, twice there, elsewhere, empty, or another."""
    lines = text.split("\n")
    at, to = (int(n) for n in rng.integers(len(lines), size=2))
    line = lines[at]
    changes = (
        lambda: lines.pop(at),
        lambda: lines.insert(to, line),
        lambda: lines.insert(to, lines.pop(at)),
        lambda: lines.__setitem__(at, word(rng)),
        lambda: lines.__setitem__(at, f"{line} {word(rng)}"),
        lambda: lines.__setitem__(at, line.replace(" ", word(rng), 1)),
    )
    changes[rng.integers(len(changes))]()
    return "\n".join(lines)


def other_word(text: str, rng: np.random.Generator) -> str:
    """A word stands somewhere."""
    at = int(rng.integers(len(text) + 1))
    return text[:at] + word(rng) + text[at:]


def spoilt_text(data: bytes, rng: np.random.Generator) -> tuple[str, bytes]:
    """As `spoilt`, by words and lines; in another encoding at times."""
    changes = (other_number, other_number, other_line, other_word)
    how = changes[rng.integers(len(changes))]
    text = how(data.decode("utf-8"), rng)
    encoding = rng.choice(["utf-8", "utf-8", "utf-8", "utf-16", "latin-1"])
    return f"{how.__name__} in {encoding}", text.encode(str(encoding), "replace")
