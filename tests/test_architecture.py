"""Reads the imports of every module and holds them against the dependency rule of the design."""

import ast
import re
import sys
import tomllib
from collections.abc import Iterable, Iterator
from functools import lru_cache
from pathlib import Path

import vnav

ROOT = Path(__file__).parent.parent

# From the top down: a module imports from levels below its own; siblings do not import each other.
LEVELS = (
    {"__main__"},
    {"cli"},
    {"api"},
    {"batch", "doctor", "synthetic"},
    {"reporting"},
    {"evaluation"},
    {"pipeline"},
    {"stages"},
    {"tracking", "loop_closing", "optimisation", "checking", "calibration", "lighting", "overlays"},
    {
        *("io", "features", "masking", "registration"),
        *("volumes", "vocabulary", "localisation", "planning"),
    },
    {"core"},
    {"threads", "compiled"},
    {"config", "configs", "datasets"},
    {"errors", "caches", "memory"},
    {"vnav"},  # the version
)

# Native libraries have one owner each; where a name is not listed, no module may import it.
OWNERS = {
    "gtsam": {"vnav.optimisation.pose_graph"},
    "octomap": {"vnav.volumes.octree"},
    "pillow_heif": {"vnav.io.photos.heic"},
    "rosbags": {"vnav.io.recordings.ros_bag"},
    "apsw": {"vnav.io.recordings.ros_bag"},
    "imagecodecs": {"vnav.io.formats.record3d_file"},
    "laspy": {"vnav.io.formats.las"},
    "rerun": {"vnav.io.formats.rrd"},
    "open3d": {"vnav.volumes"},
    "sklearn": {"vnav.vocabulary"},
    "click": {"vnav.cli"},
    "distributed": {"vnav.batch"},
    "cv2": {
        *("vnav.io", "vnav.features", "vnav.masking", "vnav.registration", "vnav.localisation"),
        *("vnav.synthetic", "vnav.stages", "vnav.tracking", "vnav.checking", "vnav.reporting"),
        *("vnav.vocabulary", "vnav.threads", "vnav.calibration", "vnav.lighting", "vnav.overlays"),
    },
    "matplotlib": {"vnav.reporting"},
    "msgspec": {"vnav.io.store"},
    "numpy": {"vnav"},
    "numba": {"vnav.compiled"},
    "scipy": {"vnav"},
    "threadpoolctl": {"vnav.threads"},
}

# Locating a photo goes through these in turn: each knows what came before it, never what follows.
ROOMS_OF_LOCATING = ("search", "hypotheses", "verification", "verdict")

STAGES = ("odometry", "vocabulary", "loops", "optimise", "fuse", "index")
HEAVY = {"open3d", "sklearn", "gtsam", "octomap", "numba", "matplotlib", "scipy", "distributed"}


def _modules() -> dict[str, Path]:
    folders = {"vnav": "vnav", "cli": "vnav.cli", "configs": "vnav.configs"}
    folders["datasets"] = "vnav.datasets"
    found = {}
    for folder, package in folders.items():
        for path in sorted((ROOT / folder).rglob("*.py")):
            parts = path.relative_to(ROOT / folder).with_suffix("").parts
            name = ".".join((package, *parts)).removesuffix(".__init__")
            found[name] = path
    return found


MODULES = _modules()


@lru_cache
def _tree(module: str) -> ast.Module:
    return ast.parse(MODULES[module].read_text("utf-8"), str(MODULES[module]))


def _imports(nodes: Iterable[ast.AST]) -> Iterator[str]:
    """Full names of what these nodes import; ``from a import b`` is a.b."""
    for node in nodes:
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            yield from (f"{'.' * node.level}{node.module}.{alias.name}" for alias in node.names)


IMPORTS = {module: list(_imports(ast.walk(_tree(module)))) for module in MODULES}
LIBRARIES = {
    module: {name.split(".")[0] for name in names} - sys.stdlib_module_names - {"vnav"}
    for module, names in IMPORTS.items()
}


def _within(module: str, owner: str) -> bool:
    return module == owner or module.startswith(f"{owner}.")


def _part(name: str) -> str:
    """The part of the house a module, or a name imported from it, belongs to."""
    names = name.split(".")
    return names[1] if len(names) > 1 and f"vnav.{names[1]}" in MODULES else "vnav"


def _level(name: str) -> int:
    return next(i for i, parts in enumerate(LEVELS) if _part(name) in parts)


def test_every_module_has_its_place_in_the_house() -> None:
    assert {_part(module) for module in MODULES} <= set().union(*LEVELS)


def test_every_folder_with_modules_is_an_installed_package() -> None:
    folders = {path.parent for path in MODULES.values()}
    assert not [folder for folder in folders if not (folder / "__init__.py").is_file()]
    project = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))
    packages = {name for name, path in MODULES.items() if path.name == "__init__.py"}
    assert set(project["tool"]["setuptools"]["packages"]) == packages


def test_the_document_tells_the_levels_as_they_are() -> None:
    text = (ROOT / "ARCHITECTURE.md").read_text("utf-8")
    listed = re.findall(r"^## Levels.*?```text\n(.*?)```", text, re.M | re.S)[0]
    assert [set(line.split()) for line in listed.splitlines()] == list(LEVELS)


def test_the_document_names_every_package() -> None:
    text = (ROOT / "ARCHITECTURE.md").read_text("utf-8")
    packages = {path.parent for path in MODULES.values() if path.name == "__init__.py"}
    named = {f"{package.relative_to(ROOT)}/" for package in packages - {ROOT / "vnav"}}
    assert not [name for name in named if f"`{name}`" not in text]


def test_imports_are_absolute_and_point_down() -> None:
    wrong = [
        f"{module} imports {name}"
        for module, names in IMPORTS.items()
        for name in names
        if name.startswith(".")
        or name.startswith("vnav")
        and module != "vnav"  # offers what lies above, and loads it when it is asked for
        and _part(name) != _part(module)
        and _level(name) <= _level(module)
    ]
    assert not wrong


def test_what_the_package_offers_is_for_others_inside_only_its_version_is_used() -> None:
    inside = {
        name
        for names in IMPORTS.values()
        for name in names
        if name.startswith("vnav") and _part(name) == "vnav"
    }
    assert inside - set(IMPORTS["vnav"]) == {"vnav.__version__"}


def test_the_package_offers_what_type_checkers_are_told() -> None:
    """The names under TYPE_CHECKING, those of `__all__` and those that are found are the same."""
    imported = {name for name in IMPORTS["vnav"] if name.startswith("vnav.")}
    assert set(vnav.__all__) == {name for name in dir(vnav) if name in vnav.__all__}
    assert {place.replace(":", ".") for place in vnav._PLACES.values()} <= imported
    assert set(vnav.__all__) == set(vnav._PLACES) | {
        name.rpartition(".")[2] for name in imported if name.startswith("vnav.errors.")
    }
    assert all(getattr(vnav, name) is not None for name in vnav.__all__)


def _room_of_locating(name: str) -> int:
    """How far a photo has come in a module, or in one that a name is imported from; 0: not yet."""
    rooms = enumerate(ROOMS_OF_LOCATING, 1)
    return next((n for n, room in rooms if _within(name, f"vnav.localisation.{room}")), 0)


def test_a_photo_is_searched_posed_verified_and_judged_in_this_order() -> None:
    """What a photo and its map are knows of no room; the top function alone knows all of them."""
    modules = [m for m in MODULES if _within(m, "vnav.localisation")]
    assert {_room_of_locating(m) for m in modules} == set(range(len(ROOMS_OF_LOCATING) + 1))
    wrong = [
        f"{module} imports {name}"
        for module in modules
        for name in IMPORTS[module]
        if module != "vnav.localisation.localise"
        if name == "vnav.localisation.localise.localise"
        or _room_of_locating(name) > _room_of_locating(module)
    ]
    assert not wrong


def test_a_library_is_imported_only_by_its_owners() -> None:
    wrong = [
        f"{module} imports {library}"
        for module, libraries in LIBRARIES.items()
        for library in libraries
        if not any(_within(module, owner) for owner in OWNERS.get(library, ()))
    ]
    assert not wrong


def test_in_the_volumes_the_octree_alone_knows_octomap_and_nothing_else_does() -> None:
    for module in MODULES:
        if _within(module, "vnav.volumes"):
            other = "open3d" if module == "vnav.volumes.octree" else "octomap"
            assert other not in LIBRARIES[module], module


def test_core_is_numpy_only_and_touches_no_files() -> None:
    for module in MODULES:
        if _within(module, "vnav.core"):
            assert LIBRARIES[module] <= {"numpy"}, module
            roots = {name.split(".")[0] for name in IMPORTS[module]}
            assert not roots & {"pathlib", "os", "io", "json", "shutil", "tempfile"}, module


def test_the_command_line_is_thin() -> None:
    for module in MODULES:
        if _within(module, "vnav.cli"):
            assert LIBRARIES[module] <= {"click"}, module


def test_the_command_line_asks_the_api() -> None:
    """It parses, calls, and prints; what computes is not within its reach."""
    below = {"batch", "stages", "tracking", "optimisation", "loop_closing", "registration"}
    below |= {"features", "masking", "volumes", "vocabulary", "planning"}
    wrong = [
        f"{module} imports {name}"
        for module, names in IMPORTS.items()
        for name in names
        if _within(module, "vnav.cli") and name.startswith("vnav.") and _part(name) in below
    ]
    assert not wrong


def test_stages_meet_on_disk_not_in_imports() -> None:
    """Only the pipeline, which is above them, calls the stages that make a map."""
    building = {f"vnav.stages.{stage}" for stage in STAGES}
    wrong = [
        f"{module} imports {name}"
        for module, names in IMPORTS.items()
        for name in names
        if _within(module, "vnav.stages")
        if any(_within(name, stage) and module != stage for stage in building)
    ]
    assert not wrong


def test_no_module_catches_everything() -> None:
    caught = [
        (module, node.lineno)
        for module in MODULES
        for node in ast.walk(_tree(module))
        if isinstance(node, ast.ExceptHandler)
        if node.type is None or ast.unparse(node.type) in {"Exception", "BaseException"}
    ]
    assert not caught


def test_no_module_pickles() -> None:
    picklers = {"pickle", "joblib", "dill", "shelve", "marshal"}
    for module, names in IMPORTS.items():
        assert not {name.split(".")[0] for name in names} & picklers, module
        for node in ast.walk(_tree(module)):
            if isinstance(node, ast.keyword) and node.arg == "allow_pickle":
                assert ast.unparse(node.value) == "False", (module, node.value.lineno)


def test_no_module_prints_or_draws_numbers_without_a_seed() -> None:
    calls = [
        (module, node.lineno, ast.unparse(node.func), node.args)
        for module in MODULES
        for node in ast.walk(_tree(module))
        if isinstance(node, ast.Call)
    ]
    assert calls
    assert not [(m, line) for m, line, called, _ in calls if called == "print"]
    seedless = [(m, line) for m, line, call, a in calls if call.endswith("default_rng") and not a]
    assert not seedless


def test_the_command_line_starts_without_heavy_libraries() -> None:
    """No cli module imports one at module level, nor does anything it imports there."""
    reached: set[str] = set()
    todo = {name for name in MODULES if _within(name, "vnav.cli")}
    while todo:
        module = todo.pop()
        reached.add(module)
        names = set(_imports(_tree(module).body))
        heavy = {name.split(".")[0] for name in names} & HEAVY
        assert not heavy, f"{module} imports {heavy} when it is imported"
        names |= {name.rpartition(".")[0] for name in names}
        todo |= (names & MODULES.keys()) - reached
