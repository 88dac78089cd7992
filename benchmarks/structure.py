"""How large and how tangled the code is: rooms, long and branching functions, import chains, names.

    python benchmarks/structure.py . ../vnav-before

Nothing is imported: sources are parsed. The tests hold the limits; this shows how far off they are.
"""

import argparse
import ast
from collections import Counter
from collections.abc import Iterator
from functools import cache
from pathlib import Path

BRANCHES = (ast.If, ast.IfExp, ast.For, ast.While, ast.ExceptHandler, ast.Assert, ast.comprehension)
LONG, BRANCHING, TANGLED = 40, 10, 12
Function = ast.FunctionDef | ast.AsyncFunctionDef


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("checkouts", nargs="+", type=Path, help="folders with vnav/ and cli/")
    for checkout in parser.parse_args().checkouts:
        modules = parsed(checkout)
        print(f"\n## {checkout.resolve().name}: {len(modules)} modules\n")
        for line in (*rooms(checkout, modules), *functions(modules), *names(modules)):
            print(line)
        chain = max((longest(module, modules) for module in modules), key=len)
        print(f"longest import chain: {len(chain)}: {' > '.join(chain)}")


def parsed(checkout: Path) -> dict[str, ast.Module]:
    """Modules by their full name, vnav.cli among them."""
    found = {}
    for folder, package in (("vnav", "vnav"), ("cli", "vnav.cli")):
        for path in sorted((checkout / folder).rglob("*.py")):
            parts = path.relative_to(checkout / folder).with_suffix("").parts
            name = ".".join((package, *parts)).removesuffix(".__init__")
            found[name] = ast.parse(path.read_text("utf-8"))
    return found


def rooms(checkout: Path, modules: dict[str, ast.Module]) -> Iterator[str]:
    """Modules and lines of each folder, and the largest one's share."""
    lines: Counter[str] = Counter()
    count: Counter[str] = Counter()
    for name in modules:
        folder = name.split(".")[1:-1] if f"{name}." not in name else []
        path = checkout / "/".join(name.replace("vnav.cli", "cli").split("."))
        file = path / "__init__.py" if path.is_dir() else path.with_suffix(".py")
        room = ".".join(folder) or (name.split(".")[1] if path.is_dir() and "." in name else "vnav")
        lines[room] += len(file.read_text("utf-8").splitlines())
        count[room] += 1
    total = sum(lines.values())
    yield f"{'room':28}{'modules':>8}{'lines':>8}{'share':>8}"
    for room, size in sorted(lines.items()):
        yield f"{room:28}{count[room]:8}{size:8}{size / total:8.0%}"
    yield f"{'all':28}{sum(count.values()):8}{total:8}"


def functions(modules: dict[str, ast.Module]) -> Iterator[str]:
    """Long and branching functions; lines without the docstring."""
    found = [
        (f"{name}:{node.name}", length(node), complexity(node))
        for name, tree in modules.items()
        for node in ast.walk(tree)
        if isinstance(node, Function)
    ]
    long = [f"{name} {lines}" for name, lines, _ in found if lines > LONG]
    branching = [f"{name} {branches}" for name, _, branches in found if branches > BRANCHING]
    tangled = [name for name, _, branches in found if branches > TANGLED]
    yield f"\nfunctions: {len(found)}; of more than {LONG} lines: {len(long)} {long}"
    yield f"complexity over {BRANCHING}: {len(branching)} {branching}"
    yield f"complexity over {TANGLED}: {len(tangled)}"


def length(function: Function) -> int:
    """Lines from the signature to the end, those of the docstring left out."""
    documented = ast.get_docstring(function, clean=False)
    doc = function.body[0] if documented is not None else None
    return _lines(function) - (_lines(doc) if doc else 0)


def _lines(node: ast.stmt) -> int:
    return (node.end_lineno or node.lineno) - node.lineno + 1


def complexity(function: Function) -> int:
    """McCabe's number: one, and one for each branch; nested functions count for themselves."""
    total, todo = 1, list(ast.iter_child_nodes(function))
    while todo:
        node = todo.pop()
        if isinstance(node, Function | ast.Lambda):
            continue
        total += isinstance(node, BRANCHES)
        total += len(node.values) - 1 if isinstance(node, ast.BoolOp) else 0
        todo += ast.iter_child_nodes(node)
    return total


def names(modules: dict[str, ast.Module]) -> Iterator[str]:
    """Names of classes, and of files of vnav, that stand more than once."""
    classes = Counter(
        node.name
        for tree in modules.values()
        for node in ast.walk(tree)
        if isinstance(node, ast.ClassDef)
    )
    files = Counter(name.rpartition(".")[2] for name in modules if not name.startswith("vnav.cli"))
    yield f"classes of one name: {sorted(n for n, count in classes.items() if count > 1)}"
    yield f"files of one name: {sorted(n for n, count in files.items() if count > 1)}"


def longest(module: str, modules: dict[str, ast.Module]) -> list[str]:
    """The longest chain of imports that begins with a module, nothing twice in it."""

    @cache
    def below(name: str) -> tuple[str, ...]:
        chains = (below(other) for other in sorted(imports(name, modules)))
        return (name, *max(chains, key=len, default=()))

    return list(below(module))


def imports(module: str, modules: dict[str, ast.Module]) -> set[str]:
    """Modules that one imports; the root package, which loads lazily, is left out."""
    found = set()
    for node in ast.walk(modules[module]):
        if isinstance(node, ast.ImportFrom) and node.module:
            wanted = {f"{node.module}.{alias.name}" for alias in node.names} | {node.module}
            found |= wanted & modules.keys()
    return found - {"vnav", module} if module != "vnav" else set()


if __name__ == "__main__":
    main()
