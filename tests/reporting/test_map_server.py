"""What serves a map's page: the whole cloud and surface to this machine, and nothing else."""

import http.client
import json
import shutil
import socket
from collections.abc import Iterator
from pathlib import Path
from threading import Thread
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from vnav.errors import MapError
from vnav.io.store.artifacts import load_cloud, load_mesh
from vnav.io.store.map_folder import MapFolder
from vnav.reporting import map_pictures
from vnav.reporting.layers import STEPS
from vnav.reporting.map_server import GONE, HOST, MapServer, addresses


class Visitor:
    """Asks a server as a browser does."""

    def __init__(self, server: MapServer) -> None:
        self.server = server

    def get(self, address: str, **headers: str) -> tuple[int, str, bytes]:
        """Status, kind and content of an answer; the address is sent as it is."""
        connection = http.client.HTTPConnection(HOST, self.server.server_port, timeout=60)
        connection.request("GET", address, headers=headers)
        answer = connection.getresponse()
        found = answer.status, answer.headers["Content-Type"], answer.read()
        connection.close()
        return found

    def address_of(self, layer: str) -> str:
        """Where a layer is."""
        return addresses(self.server.folder)[layer]

    def layer(self, name: str) -> dict[str, Any]:
        """The numbers and arrays of a layer."""
        status, _, content = self.get(self.address_of(name))
        assert status == 200
        start = 4 + int(np.frombuffer(content, "<u4", 1)[0])
        told = json.loads(content[4:start])
        arrays = {k: content[start + a : start + b] for k, (a, b) in told.pop("arrays").items()}
        return told | arrays


@pytest.fixture
def visited(fused_map: Path, tmp_path: Path) -> Iterator[Visitor]:
    root = shutil.copytree(fused_map, tmp_path / "map")
    with MapServer(MapFolder(root)) as server:
        thread = Thread(target=server.serve_forever, args=(0.05,))
        thread.start()
        yield Visitor(server)
        server.shutdown()
        thread.join()


def points_of(layer: dict[str, Any]) -> NDArray[np.float64]:
    steps = np.frombuffer(layer["positions"], "<u2").reshape(-1, 3)
    return np.array(layer["low"]) + steps / STEPS * np.array(layer["span"])


def test_the_whole_cloud_is_served(visited: Visitor) -> None:
    cloud, layer = load_cloud(visited.server.folder), visited.layer("cloud")
    found = np.c_[points_of(layer), np.frombuffer(layer["colors"], "u1").reshape(-1, 3)]
    wanted = np.c_[cloud.points_world.astype(float), cloud.colors]
    half_a_step_m = np.array(layer["span"]) / STEPS / 2 + 1e-6
    np.testing.assert_allclose(found.mean(0)[:3], wanted.mean(0)[:3], atol=half_a_step_m.max())
    assert sorted(map(tuple, found[:, 3:])) == sorted(map(tuple, wanted[:, 3:]))


def test_the_surface_is_that_of_the_map(visited: Visitor) -> None:
    mesh, layer = load_mesh(visited.server.folder), visited.layer("mesh")
    half_a_step_m = np.array(layer["span"]) / STEPS / 2 + 1e-6
    assert (np.abs(points_of(layer) - mesh.vertices_world) < half_a_step_m).all()
    assert layer["colors"] == mesh.colors.tobytes()
    number = "<u2" if len(mesh.vertices_world) <= 65536 else "<u4"
    assert (np.frombuffer(layer["triangles"], number).reshape(-1, 3) == mesh.triangles).all()


def test_nothing_but_the_page_and_its_layers_is_served(visited: Visitor) -> None:
    root = visited.server.folder.root
    for address in (
        "/map.json",
        "/../map/map.json",
        "/..%2fmap%2fmap.json",
        f"//{root}/map.json",
        f"{root}/map.json",
        visited.address_of("cloud") + "/../../map.json",
        visited.address_of("cloud") + ".ply",
        "/fuse/cloud.ply",
        "map.json",
        "",
    ):
        status, _, content = visited.get(address or "*")
        assert (status, content) == (404, GONE.encode()), address


def test_only_this_machine_is_served(visited: Visitor) -> None:
    assert visited.server.server_address[0] == "127.0.0.1"
    port = visited.server.server_port
    for host, status in (
        (f"localhost:{port}", 404),
        ("127.0.0.1:8080", 404),  # through a tunnel
        (f"evil.example:{port}", 403),  # its name may be made to lead here
        ("[", 403),
    ):
        assert visited.get("/nothing", Host=host)[0] == status, host


def test_the_page_is_that_of_the_map_as_it_is_when_it_is_asked_for(
    visited: Visitor, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(map_pictures, "drawn", lambda _folder: {})  # takes long
    folder = visited.server.folder
    assert b"path, 1.0 m" not in visited.get("/")[2]
    folder.write_planned({"path_m": [[0, 1, 3.1], [1, 1, 0.5]], "length_m": 1.0})
    assert b"path, 1.0 m" in visited.get("/")[2]


def test_nothing_is_written_into_the_map(visited: Visitor) -> None:
    root = visited.server.folder.root
    before = {path: path.stat().st_mtime_ns for path in root.rglob("*")}
    assert visited.get("/")[0] == 200
    assert {path: path.stat().st_mtime_ns for path in root.rglob("*")} == before


def test_a_damaged_map_is_told_and_served_again_when_it_is_mended(visited: Visitor) -> None:
    path, address = visited.server.folder.root / "fuse" / "mesh.ply", visited.address_of("mesh")
    whole = path.read_bytes()
    path.write_bytes(whole[:-1])
    status, kind, content = visited.get(address)
    assert (status, kind) == (500, "text/plain")
    assert content.startswith(b"vnav: expected ")
    assert b"vnav fuse" in content
    path.write_bytes(whole)
    assert visited.get(address)[0] == 200


def test_a_map_that_is_not_fused_has_a_page_too(posed_map: Path) -> None:
    with MapServer(MapFolder(posed_map)) as server:
        thread = Thread(target=server.serve_forever, args=(0.05,))
        thread.start()
        status, _, content = Visitor(server).get("/")
        server.shutdown()
        thread.join()
    assert status == 200
    assert b"not fused yet" in content


def test_a_port_that_is_taken_is_an_error(fused_map: Path) -> None:
    with socket.create_server((HOST, 0)) as taken:
        port = taken.getsockname()[1]
        with pytest.raises(MapError, match=rf"expected port {port} .* in use; name another"):
            MapServer(MapFolder(fused_map), port)
