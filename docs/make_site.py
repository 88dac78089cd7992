"""Makes the documentation a site: README.md, the pages beside it, and docs/.

    python docs/make_site.py [--out DIR]

The site is DIR/site. It works from the disk, without a network. Links that lead nowhere are errors.
"""

import argparse
import os
import shutil
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parent.parent
SHOWN = (
    "*.md",
    "LICENSE",
    "docs/*.md",
    "docs/*.ipynb",
    "docs/pictures/*",
    "docs/site/*",
    "datasets/*.toml",
)
QUIET = {"NO_MKDOCS_2_WARNING": "1"}  # docs/decisions.md says it


def main() -> None:
    """Build the site and say where it is."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=ROOT / "build")
    print(build(parser.parse_args().out))


def build(out: Path) -> Path:
    """The first page of the site; exit where a page is missed, or a link leads nowhere."""
    for made in ("pages", "site"):
        shutil.rmtree(out / made, ignore_errors=True)
    for path in (path for pattern in SHOWN for path in ROOT.glob(pattern)):
        copy = out / "pages" / path.relative_to(ROOT)
        copy.parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(path, copy)
    shutil.move(out / "pages" / "docs" / "site" / "mkdocs.yml", out / "mkdocs.yml")
    command = [sys.executable, "-m", "mkdocs", "build"]
    if code := subprocess.run(command, cwd=out, env=os.environ | QUIET).returncode:
        sys.exit(code)
    return out / "site" / "index.html"


if __name__ == "__main__":
    main()
