"""The Dockerfile, by the script that carries it out where there is no docker; no command is run."""

import re
import tomllib
from pathlib import Path
from types import ModuleType, SimpleNamespace

import pytest

from tests.scripts import loaded
from tests.test_packaging import SOURCES

ROOT = Path(__file__).parent.parent
DOCKERFILE = (ROOT / "Dockerfile").read_text("utf-8")
README = (ROOT / "README.md").read_text("utf-8")


@pytest.fixture(scope="module")
def script() -> ModuleType:
    return loaded(ROOT / ".ci" / "dockerfile_in_chroot.py")


@pytest.fixture(scope="module")
def image(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with what debootstrap would have made before anything is copied."""
    root = tmp_path_factory.mktemp("image")
    (root / "etc").mkdir()
    return root


@pytest.fixture(scope="module")
def commands(script: ModuleType, image: Path) -> list[str]:
    """What the script would have run for `vnav info`, in turn; only files are copied."""
    return carried_out(script, image)


def carried_out(script: ModuleType, image: Path) -> list[str]:
    found = list[str]()

    def run(command: list[object], **_: bool) -> SimpleNamespace:
        found.append(" ".join(map(str, command)))
        return SimpleNamespace(returncode=0)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(script.subprocess, "run", run)
        patch.setattr("sys.argv", ["script", str(image), "info"])
        script.main()
    return found


def test_the_image_is_made_of_what_a_wheel_is_made_of(commands: list[str], image: Path) -> None:
    copied = {path.name for path in (image / "source").iterdir()}
    assert copied == {*SOURCES, "Makefile", "constraints.txt"}
    assert commands[0].startswith("debootstrap")
    assert (image / "source" / "vnav" / "py.typed").is_file()


def test_the_makefile_alone_names_the_system_libraries(commands: list[str]) -> None:
    """So the Dockerfile installs what the README asks for, and make the rest."""
    named = re.search(r"apt-get install((?: --?[\w-]+)*)((?: [\w.+-]+)*)", commands[1])
    assert named is not None
    assert set(named[2].split()) == {"make", "python3", "python3-venv"}
    assert all(re.search(rf"\b{name}\b", README) for name in named[2].split())
    assert "make -C /source system" in commands[1]


def test_the_image_brings_the_extras_that_a_user_may_want(commands: list[str]) -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
    named = re.search(r"'/source\[(.+)\]'", commands[2])
    assert named is not None
    left_out = {"bench", "docs", "test", "cluster"} | {"rerun"}  # for developers; 700 MB
    assert set(named[1].split(",")) == set(project["optional-dependencies"]) - left_out


def test_vnav_runs_as_somebody_who_is_not_root(commands: list[str]) -> None:
    assert "--userspec=root:root" in commands[1]
    assert "--userspec=vnav:vnav" in commands[-1]
    assert commands[-1].endswith("/data /opt/vnav/bin/vnav info")


def test_the_readme_mounts_the_folders_that_the_image_has(commands: list[str]) -> None:
    mounted = set(re.findall(r"--volume \"?[$\w]+:([/\w]+)", README))
    assert mounted == {"/data", "/home/vnav"}
    assert mounted <= set(commands[3].split())


@pytest.mark.usefixtures("commands")
def test_a_folder_that_this_dockerfile_made_is_kept(script: ModuleType, image: Path) -> None:
    (image / "source" / "LICENSE").unlink()
    (again,) = carried_out(script, image)
    assert again.endswith("/data /opt/vnav/bin/vnav info")
    assert not (image / "source" / "LICENSE").exists()


def test_a_line_that_the_script_does_not_know_is_refused(
    script: ModuleType, tmp_path: Path
) -> None:
    image = script.Image(tmp_path)
    with pytest.raises(ValueError, match="HEALTHCHECK"):
        image.carry_out("HEALTHCHECK", "NONE")
    with pytest.raises(ValueError, match="alpine"):
        image.carry_out("FROM", "alpine:3")
