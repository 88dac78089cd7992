"""The documents read plainly, link to what is there, and tell of every step that code cites."""

import ast
import re
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
DOCS = sorted((ROOT / "docs").glob("*.md"))
PAGES = [*sorted(ROOT.glob("*.md")), *DOCS]
WITHOUT_COMMITS = [page for page in PAGES if page.name != "results.md"]  # says what was measured

MOST_WORDS = 30
FENCED = re.compile(r"^ *```.*?^ *```", re.M | re.S)
COMMIT = re.compile(r"\b(?=[0-9a-f]*[0-9])(?=[0-9a-f]*[a-f])[0-9a-f]{7,40}\b")
LINK = re.compile(r"\]\(([^)\s]+)\)")
PATH = re.compile(r"`((?:vnav|cli|tests|benchmarks|configs|datasets|docs)/[\w./-]*\w/?)`")
NAME = re.compile(r"`(vnav(?:\.\w+)+)")
CITATION = re.compile(r"[Cc]laims? \d(.*?)(?:;|\)|\. |\.$|\Z)", re.M)
STEP = re.compile(r"\bS[1-8]\b|\b[23]\.\d{1,2}\b")
ABBREVIATIONS = ("e.g.", "i.e.", "et al.", "vs.", "approx.", "ed.")


def _of(pages: list[Path]) -> pytest.MarkDecorator:
    return pytest.mark.parametrize("page", pages, ids=lambda page: page.name)


def _text(page: Path) -> str:
    """A page without its code blocks."""
    return FENCED.sub("", page.read_text("utf-8"))


def _blocks(page: Path) -> Iterator[str]:
    """Paragraphs and list items, each one line; no headings, tables or pictures."""
    lines = [
        "" if re.match(r" *(#|\||!\[|<!--)", line) else line for line in _text(page).splitlines()
    ]
    parts = re.split(r"\n\s*\n|\n(?= *(?:[-*]|\d+\.) )", "\n".join(lines))
    for part in parts:
        plain = re.sub(r"^\s*(?:[-*]|\d+\.) ", "", part)
        plain = re.sub(r"`[^`]*`", "code", plain.replace("\n", " "))
        plain = re.sub(r"!?\[([^\]]*)\]\([^)]*\)", r"\1", plain).replace("**", "")
        if plain.strip():
            yield re.sub(r"\s+", " ", plain.strip())


def _sentences(page: Path) -> Iterator[str]:
    for block in _blocks(page):
        for short in ABBREVIATIONS:
            block = re.sub(rf"\b{re.escape(short)}", short.replace(".", ""), block)
        yield from re.split(r"(?<=[.!?])[)\"*]* ", block)


def _anchors(page: Path) -> set[str]:
    """What a page's headings are linked by, as GitHub does."""
    headings = re.findall(r"^#+ +(.+?) *$", _text(page), re.M)
    bare = [re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", heading).lower() for heading in headings]
    return {re.sub(r"[^\w\- ]", "", heading).replace(" ", "-") for heading in bare}


def _links(page: Path) -> list[tuple[Path, str]]:
    """The files of the project that a page links to, and the headings in them."""
    targets = [t for t in LINK.findall(_text(page)) if not re.match(r"\w+:", t)]
    parts = [target.partition("#") for target in targets]
    return [((page.parent / path).resolve() if path else page, at) for path, _, at in parts]


@_of(PAGES)
def test_no_sentence_is_longer_than_thirty_words(page: Path) -> None:
    counted = [(len(sentence.split()), sentence) for sentence in _sentences(page)]
    assert counted
    assert not [(words, sentence) for words, sentence in counted if words > MOST_WORDS]


@_of(WITHOUT_COMMITS)
def test_no_commit_is_named_in_prose(page: Path) -> None:
    assert not COMMIT.findall(_text(page))


@_of(PAGES)
def test_every_link_leads_somewhere(page: Path) -> None:
    for target, anchor in _links(page):
        assert target.exists(), target
        assert not anchor or anchor in _anchors(target), f"{target.name}#{anchor}"


@_of(PAGES)
def test_a_list_is_one_on_github_and_in_the_site(page: Path) -> None:
    """The site wants an empty line before a list, and four spaces before a list within one."""
    for before, line in pairwise(_text(page).splitlines()):
        if item := re.match(r"( *)(?:[-*]|\d+\.) ", line):
            assert len(item[1]) % 4 == 0, line
            assert not before or re.match(r" |[-*] |\d+\. ", before), line


def test_every_page_is_linked_from_another() -> None:
    linked = {target for page in PAGES for target, _ in _links(page) if target != page}
    assert not {*PAGES} - linked - {ROOT / "README.md"}


def test_pictures_are_small_and_shown() -> None:
    pictures = sorted((ROOT / "docs/pictures").glob("*"))
    sizes = [picture.stat().st_size for picture in pictures]
    assert max(sizes) < 150_000
    assert sum(sizes) < 600_000
    assert set(pictures) <= {target for page in PAGES for target, _ in _links(page)}


@_of(PAGES)
def test_every_path_and_module_that_a_page_names_exists(page: Path) -> None:
    no_paths = {"vnav/datasets", "benchmarks/NAME.py"}  # a folder of the user's cache, any name
    paths = set(PATH.findall(_text(page))) - no_paths
    assert not [path for path in paths if not (ROOT / path).exists()]
    assert not [name for name in NAME.findall(_text(page)) if not _is_defined(name)]


def _is_defined(name: str) -> bool:
    """Whether a dotted name is a module, or a module's own name."""
    parts = name.split(".")
    if parts[1] in ("cli", "configs", "datasets"):
        parts = parts[1:]
    path = ROOT.joinpath(*parts)
    if path.is_dir() or path.with_suffix(".py").is_file():
        return True
    module = next(
        (m for m in (path.parent.with_suffix(".py"), path.parent / "__init__.py") if m.is_file()),
        None,
    )
    return (
        module is not None and re.search(rf"\b{parts[-1]}\b", module.read_text("utf-8")) is not None
    )


def _cited() -> dict[str, set[str]]:
    """Steps of the method that docstrings cite, by module."""
    found: dict[str, set[str]] = {}
    for path in sorted((ROOT / "vnav").rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text("utf-8"))):
            if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef):
                docstring = ast.get_docstring(node) or ""
                for citation in CITATION.findall(docstring):
                    steps = STEP.findall(citation)
                    found.setdefault(path.relative_to(ROOT).as_posix(), set()).update(steps)
    return found


def test_every_step_that_a_docstring_cites_stands_in_the_method() -> None:
    cited = set().union(*_cited().values())
    told = set(re.findall(r"^\*\*(S\d|\d\.\d+)\*\*", (ROOT / "docs/method.md").read_text(), re.M))
    assert len(cited) > 15
    assert not cited - told


def test_every_module_that_cites_a_step_or_its_package_is_named_by_the_method() -> None:
    named = {p.rstrip("/") for p in PATH.findall((ROOT / "docs/method.md").read_text("utf-8"))}
    for module in _cited():
        assert named & {module, *map(str, Path(module).parents)}, module


def test_nobody_is_told_to_install_the_vnav_of_somebody_else() -> None:
    """Ours is called otherwise on the package index."""
    texts = [*ROOT.glob("*.md"), *DOCS, *ROOT.glob("*/**/*.py"), ROOT / "Makefile"]
    kept = [path for path in texts if not {".venv", "tests", "build"} & set(path.parts)]
    told = re.compile(r"(?:pip|uv|pipx|uvx)\s+(?:install|add)[^`\n]*[\s'\"]vnav(?![\w-])")
    assert len(kept) > 100
    assert not [path for path in kept if told.search(path.read_text("utf-8"))]
