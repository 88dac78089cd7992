import socket
from pathlib import Path

import pytest

from vnav.errors import DatasetError
from vnav.io.datasets.download import download

CONTENT = bytes(range(256)) * 4000


@pytest.fixture
def served(file_server):
    file_server.files["/a.tgz"] = CONTENT
    return file_server


def test_a_file_comes_whole_and_nothing_else_stays(served, tmp_path: Path) -> None:
    download(f"{served.url}/a.tgz", tmp_path / "a")
    assert (tmp_path / "a").read_bytes() == CONTENT
    assert [path.name for path in tmp_path.iterdir()] == ["a"]


def test_a_connection_that_breaks_off_is_taken_up_where_it_was(served, tmp_path: Path) -> None:
    served.breaks_after = [300_000]
    download(f"{served.url}/a.tgz", tmp_path / "a")
    assert (tmp_path / "a").read_bytes() == CONTENT
    assert served.asked == ["", "bytes=300000-"]


def test_what_came_is_kept_for_the_next_run(served, tmp_path: Path) -> None:
    served.breaks_after = [300_000, 0]
    with pytest.raises(DatasetError, match="0.3 MB; these are kept, run the same command again"):
        download(f"{served.url}/a.tgz", tmp_path / "a")
    download(f"{served.url}/a.tgz", tmp_path / "a")
    assert (tmp_path / "a").read_bytes() == CONTENT
    assert served.asked[-1] == "bytes=300000-"


def test_a_server_that_knows_no_ranges_starts_over(served, tmp_path: Path) -> None:
    served.knows_ranges, served.breaks_after = False, [300_000]
    download(f"{served.url}/a.tgz", tmp_path / "a")
    assert (tmp_path / "a").read_bytes() == CONTENT
    assert served.asked == ["", "bytes=300000-"]


def test_a_server_that_breaks_off_at_the_same_place_for_ever_is_given_up(
    served, tmp_path: Path
) -> None:
    served.knows_ranges, served.breaks_after = False, [300_000] * 9
    with pytest.raises(DatasetError, match="broke off"):
        download(f"{served.url}/a.tgz", tmp_path / "a")
    assert len(served.asked) == 2


def test_a_file_that_changed_meanwhile_starts_over(served, tmp_path: Path) -> None:
    served.breaks_after = [300_000, 0]
    with pytest.raises(DatasetError):
        download(f"{served.url}/a.tgz", tmp_path / "a")
    served.files["/a.tgz"], served.tag = CONTENT[::-1], '"2"'
    download(f"{served.url}/a.tgz", tmp_path / "a")
    assert (tmp_path / "a").read_bytes() == CONTENT[::-1]


def test_without_a_sign_of_change_nothing_is_gone_on_with(served, tmp_path: Path) -> None:
    served.tag, served.breaks_after = 'W/"weak"', [300_000]
    download(f"{served.url}/a.tgz", tmp_path / "a")
    assert (tmp_path / "a").read_bytes() == CONTENT
    assert served.asked == ["", ""]


def test_a_part_of_another_address_is_not_gone_on_with(served, tmp_path: Path) -> None:
    served.files["/b.tgz"] = CONTENT[::-1]
    served.breaks_after = [300_000, 0]
    with pytest.raises(DatasetError):
        download(f"{served.url}/a.tgz", tmp_path / "part")
    download(f"{served.url}/b.tgz", tmp_path / "part")
    assert (tmp_path / "part").read_bytes() == CONTENT[::-1]


def test_progress_ends_with_the_whole(served, tmp_path: Path) -> None:
    seen = []
    download(f"{served.url}/a.tgz", tmp_path / "a", lambda *step: seen.append(step))
    assert seen[-1] == ("a.tgz, MB", 2, 2)
    assert all(done < total for _, done, total in seen[:-1])


def test_an_address_without_a_file_says_so(served, tmp_path: Path) -> None:
    with pytest.raises(DatasetError, match=r"/none.tgz, found: 404 .*--from"):
        download(f"{served.url}/none.tgz", tmp_path / "a")


def test_without_a_network_it_says_so(tmp_path: Path) -> None:
    with socket.socket() as taken:  # bound, but nobody listens
        taken.bind(("127.0.0.1", 0))
        port = taken.getsockname()[1]
        with pytest.raises(DatasetError, match=f"127.0.0.1:{port}, .*is there a network"):
            download(f"http://127.0.0.1:{port}/a.tgz", tmp_path / "a")


def test_an_address_of_this_machines_files_is_refused(tmp_path: Path) -> None:
    with pytest.raises(DatasetError, match="https://"):
        download("file:///etc/passwd", tmp_path / "a")
    assert not any(tmp_path.iterdir())
