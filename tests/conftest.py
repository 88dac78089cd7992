"""Fixtures that several parts' tests share; made once a session, read-only."""

import shutil
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass, field
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

if TYPE_CHECKING:
    from vnav.core.camera import Intrinsics
    from vnav.core.frame import Frame
    from vnav.core.mapping import Odometry
    from vnav.io.sources.capture import Capture
    from vnav.io.store.map_folder import MapFolder

    Altering = Callable[[MapFolder, str], AbstractContextManager[Path]]


@pytest.fixture
def vnav(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> Callable[..., tuple[int, str, str]]:
    """Runs a command line in this process: exit code, stdout, stderr."""
    from vnav.cli.main import main

    def run(*arguments: object) -> tuple[int, str, str]:
        monkeypatch.setattr(sys, "argv", ["vnav", *map(str, arguments)])
        code = main()
        return code, *capsys.readouterr()

    return run


@pytest.fixture(scope="session")
def tiny_capture(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A TUM folder of one synthetic room: 60 frames of 320 x 240 that close a loop, 4 photos."""
    from vnav.synthetic import MINIATURE, cached_capture  # numba: only where it is needed

    return cached_capture(MINIATURE, tmp_path_factory.mktemp("captures"))


@pytest.fixture(scope="session")
def short_capture(tmp_path_factory: pytest.TempPathFactory, tiny_capture: Path) -> Path:
    """The first 36 frames of it, which see what its first two photos do: quick to map."""
    folder = tmp_path_factory.mktemp("captures") / "short"
    folder.mkdir()
    for entry in tiny_capture.iterdir():
        if entry.suffix == ".txt" and entry.name != "groundtruth.txt":
            lines = entry.read_text().splitlines(keepends=True)
            (folder / entry.name).write_text("".join(lines[:37]))  # the first is a remark
        else:
            (folder / entry.name).symlink_to(entry)
    return folder


@pytest.fixture(scope="session")
def tiny_map(tmp_path_factory: pytest.TempPathFactory, tiny_capture: Path) -> Path:
    """A map of that room by the stages themselves, up to optimise, from half the usual features."""
    from vnav.config import CaptureConfig, Config, FeaturesConfig
    from vnav.io.sources.open_capture import open_capture
    from vnav.io.store.map_folder import MapFolder
    from vnav.stages import loops, odometry, optimise, vocabulary

    folder = MapFolder.create(tmp_path_factory.mktemp("maps") / "tiny")
    config = Config(features=FeaturesConfig(max_features=700))
    odometry.run(folder, open_capture(tiny_capture, CaptureConfig()), config)
    for stage in (vocabulary, loops, optimise):
        stage.run(folder, config)
    return folder.root


@pytest.fixture(scope="module")
def folder(tiny_map: Path) -> "MapFolder":
    """The map of the tiny capture."""
    from vnav.io.store.map_folder import MapFolder

    return MapFolder(tiny_map)


@pytest.fixture(scope="module")
def odometry(folder: "MapFolder") -> "Odometry":
    """What the odometry stage made of the tiny capture."""
    from vnav.io.store.artifacts import load_odometry

    return load_odometry(folder)


@pytest.fixture(scope="module")
def camera(folder: "MapFolder") -> "Intrinsics":
    """The camera of the tiny capture."""
    from vnav.io.store.artifacts import map_camera

    return map_camera(folder)


@pytest.fixture(scope="module")
def capture(tiny_capture: Path) -> "Capture":
    """The tiny capture, opened."""
    from vnav.config import CaptureConfig
    from vnav.io.sources.open_capture import open_capture

    return open_capture(tiny_capture, CaptureConfig())


@pytest.fixture(scope="module")
def frames(capture: "Capture") -> "list[Frame]":
    """The first six frames of the tiny capture."""
    return [capture.read(k) for k in range(6)]


@pytest.fixture(scope="session")
def posed_map(tmp_path_factory: pytest.TempPathFactory, tiny_capture: Path) -> Path:
    """A map of that room up to optimise: true poses, every fifth frame a keyframe, one frame lost.

    Its keyframes have no features. One of its two loop candidates is accepted.
    """
    import numpy as np

    from vnav.config import CaptureConfig
    from vnav.core.frame import Features
    from vnav.core.mapping import (
        LOST,
        FrameFeatures,
        FrameTable,
        Landmarks,
        LoopVerdict,
        Odometry,
        OptimisedMap,
        World,
    )
    from vnav.features.sift import SPACE
    from vnav.io.formats.trajectories import read_tum, write_tum
    from vnav.io.sources.open_capture import open_capture
    from vnav.io.store import artifacts
    from vnav.io.store.map_folder import MapFolder

    folder = MapFolder.create(tmp_path_factory.mktemp("maps") / "posed")
    capture = open_capture(tiny_capture, CaptureConfig())
    truth = read_tum(tiny_capture / "groundtruth.txt")
    camera = vars(capture.camera.color) | {"distortion": []}
    folder.set_captures([{"id": 0, "name": capture.name, "fingerprint": "", "camera": camera}])

    count, lost = len(capture), 7
    poses, segment = truth.T_world_camera.copy(), np.zeros(count, np.int32)
    poses[lost], segment[lost] = np.nan, LOST
    empty = np.zeros((0, 1), np.float32)
    none = Features(empty.reshape(0, 2), SPACE.none(), *[empty[:, 0]] * 3, SPACE)
    keyframes = tuple(FrameFeatures(r, none, empty.reshape(0, 3)) for r in range(0, count, 5))
    table = FrameTable(np.zeros(count), np.arange(count), truth.stamps_s)
    reasons = tuple("too dark" if row == lost else "" for row in range(count))
    odometry = Odometry(table, poses, segment, reasons, (), keyframes)
    with folder.writing("odometry", {}, {}) as draft:
        artifacts.save_odometry(draft, odometry)
        for keyframe in keyframes:
            artifacts.save_keyframe(draft, keyframe.row, capture.read(keyframe.row))
    verdicts = (
        LoopVerdict(0, 11, "ends", 0.5, True, "", 80, 60),
        LoopVerdict(1, 6, "appearance", 0.1, False, "too few inliers", 30, 4),
    )
    with folder.writing("loops", {}, folder.inputs_of("odometry")) as draft:
        artifacts.save_loops(draft, verdicts, (), np.zeros((0, 4), np.int32))
    nothing = np.zeros(0, np.int32)
    landmarks = Landmarks(np.zeros((0, 3)), np.zeros(0), nothing, nothing, nothing)
    covariance, world = np.zeros((len(keyframes), 6, 6)), World("floor", 9, 0)
    result = OptimisedMap(poses, covariance, landmarks, world, np.zeros(count))
    with folder.writing("optimise", {}, folder.inputs_of("odometry", "loops")) as draft:
        artifacts.save_optimised(draft, result)
        artifacts.save_verdicts(draft, verdicts)
        write_tum(draft / "trajectory_0.tum", truth)
        (draft / "graph.g2o").write_text("VERTEX_SE3:QUAT 0 0 0 0 0 0 0 1\n", "utf-8")
    return folder.root


@pytest.fixture(scope="session")
def fused_map(tmp_path_factory: pytest.TempPathFactory, posed_map: Path) -> Path:
    """That map, fused."""
    import shutil

    from vnav.config import Config
    from vnav.io.store.map_folder import MapFolder
    from vnav.stages import fuse

    root = tmp_path_factory.mktemp("maps") / "fused"
    shutil.copytree(posed_map, root)
    fuse.run(MapFolder(root), Config())
    return root


@pytest.fixture(scope="session")
def whole_map(tmp_path_factory: pytest.TempPathFactory, tiny_capture: Path, tiny_map: Path) -> Path:
    """The stages' own map of that room, finished."""
    import shutil

    from vnav.config import CaptureConfig, Config, FeaturesConfig
    from vnav.io.sources.open_capture import open_capture
    from vnav.io.store.map_folder import MapFolder
    from vnav.pipeline.build import build_map

    root = tmp_path_factory.mktemp("maps") / "whole"
    shutil.copytree(tiny_map, root)
    config = Config(features=FeaturesConfig(max_features=700))
    build_map(MapFolder(root), open_capture(tiny_capture, CaptureConfig()), config)
    return root


@pytest.fixture(scope="session")
def other_capture(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """24 frames of that room by another camera, on another path, and a photo."""
    return _recorded("one_room", tmp_path_factory.mktemp("captures") / "other")


@pytest.fixture(scope="session")
def elsewhere(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """24 frames of another place by that camera."""
    return _recorded("apartment", tmp_path_factory.mktemp("captures") / "elsewhere")


def _recorded(name: str, folder: Path) -> Path:
    """A short walk in a scene: in a small circle, the camera swinging to and fro."""
    import dataclasses

    from vnav.core.camera import Intrinsics
    from vnav.synthetic import MINIATURE, SCENES, write_capture
    from vnav.synthetic.scene import closed_tour

    tour = closed_tour((2.2, 2.0, 20), (2.8, 2.2, 60), (2.6, 2.6, 100), (2.2, 2.4, 60))
    camera = Intrinsics(360, 270, 290.0, 288.0, 183.0, 131.0)
    spec = dataclasses.replace(MINIATURE, frames=24, photos=1, camera=camera, scene="walk")
    with pytest.MonkeyPatch.context() as patch:
        scene = dataclasses.replace(SCENES[name](spec.seed), tour=tour)
        patch.setitem(SCENES, "walk", lambda seed: scene)
        write_capture(folder, dataclasses.replace(spec, height_m=1.3, pitch_deg=-15.0))
    return folder


@pytest.fixture(scope="session")
def extended_map(
    tmp_path_factory: pytest.TempPathFactory, whole_map: Path, other_capture: Path
) -> Path:
    """The finished map of that room, a pose located in it, extended by the other capture.

    It is fused more coarsely: quick.
    """
    import dataclasses
    import shutil

    from vnav.config import FuseConfig
    from vnav.io.sources.open_capture import open_capture
    from vnav.io.store.map_folder import MapFolder
    from vnav.pipeline.extend import extend, made_with

    folder = MapFolder(tmp_path_factory.mktemp("maps") / "extended")
    shutil.copytree(whole_map, folder.root)
    folder.write_current({"photo": "photo.jpg"})
    coarse = FuseConfig(voxel_m=0.05, octree_m=0.1, mesh_voxel_m=0.1)
    config = dataclasses.replace(made_with(folder), fuse=coarse)
    extend(folder, open_capture(other_capture, config.capture), config)
    return folder.root


@pytest.fixture(scope="session")
def board_photos(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Twelve photos of vnav's usual board by the camera of `tests.calibration.board_photos`."""
    from tests.calibration.board_photos import poses, write_photos
    from vnav.calibration.board import Board

    folder = tmp_path_factory.mktemp("boards") / "board_photos"
    return write_photos(folder, Board(), poses(Board(), 12))


@dataclass
class FileServer:
    """A web server for one test: what it has, how it behaves, what it was asked."""

    url: str
    files: dict[str, bytes] = field(default_factory=dict)
    tag: str = '"1"'  # ETag of all of them
    knows_ranges: bool = True
    breaks_after: list[int] = field(default_factory=list)  # bytes of the next answers, each once
    asked: list[str] = field(default_factory=list)  # the Range of each request, "" for none


@pytest.fixture
def file_server() -> Iterator[FileServer]:
    """A local HTTP server that can resume downloads, and break them off."""

    class Handler(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            wanted = self.headers.get("Range", "")
            served.asked.append(wanted)
            content = served.files.get(self.path)
            if content is None:
                self.send_error(404)
                return
            same = self.headers.get("If-Range", served.tag) == served.tag
            start = int(wanted[6:-1]) if wanted and same and served.knows_ranges else 0
            self.send_response(206 if start else 200)
            if start:
                last = len(content) - 1
                self.send_header("Content-Range", f"bytes {start}-{last}/{len(content)}")
            self.send_header("Content-Length", str(len(content) - start))
            self.send_header("ETag", served.tag)
            self.end_headers()
            count = served.breaks_after.pop(0) if served.breaks_after else len(content)
            self.wfile.write(content[start : start + count])

        def log_message(self, *arguments: object) -> None:
            pass

    server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
    served = FileServer(f"http://127.0.0.1:{server.server_port}")
    thread = threading.Thread(target=server.serve_forever, args=(0.01,))
    thread.start()
    yield served
    server.shutdown()
    server.server_close()
    thread.join()


@pytest.fixture(scope="session")
def importable(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """A folder whose modules this process and all that it starts can import."""
    folder = tmp_path_factory.mktemp("modules")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("PYTHONPATH", str(folder))
        patch.syspath_prepend(folder)
        yield folder


@pytest.fixture(scope="module")
def cluster(importable: Path) -> Iterator[Any]:
    """A Dask cluster on this machine: two workers of one thread each; a test may kill one."""
    distributed = pytest.importorskip("distributed")
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, dashboard_address=None, silence_logs=50
    ) as cluster:
        yield cluster


@contextmanager
def _altering(folder: "MapFolder", stage: str) -> Iterator[Path]:
    from vnav.io.store.map_folder import STAGES

    for name in STAGES[STAGES.index(stage) :]:
        record = folder.recorded(name)
        if not record:
            continue
        made_of = [known for known in record["inputs"] if known in STAGES]
        with folder.writing(
            name, record["settings"], record["inputs"] | folder.inputs_of(*made_of)
        ) as draft:
            shutil.copytree(folder.root / name, draft, dirs_exist_ok=True)
            (draft / "stage.json").unlink()
            if name == stage:
                yield draft


@pytest.fixture
def altering() -> "Altering":
    """Files of a finished stage are changed in a block, as if the stage had written them so."""
    return _altering
