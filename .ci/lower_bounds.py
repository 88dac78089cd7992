"""Print pyproject.toml's lower bounds, extra test included, as constraints for pip."""

import re
import tomllib
from pathlib import Path

ROOT = Path(__file__).parents[1]


def main() -> None:
    """Each requirement with its upper bound gone and its lower bound exact."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
    for requirement in (*project["dependencies"], *project["optional-dependencies"]["test"]):
        print(re.sub(r">=([\d.]+),<[\d.]+", r"==\1", requirement))


if __name__ == "__main__":
    main()
