"""vnav view as a user calls it."""

import time
import urllib.request
from pathlib import Path

from tests.cli.processes import running, stopped


def test_the_address_is_printed_and_served_until_it_is_interrupted(
    fused_map: Path, tmp_path: Path
) -> None:
    """A browser is opened where there is one: here $BROWSER names what writes the address down."""
    browser, opened = tmp_path / "browser", tmp_path / "opened"
    browser.write_text(f'#!/bin/sh\necho "$1" > {opened}.part\nmv {opened}.part {opened}\n')
    browser.chmod(0o755)
    with running("view", fused_map, BROWSER=str(browser)) as process:
        assert process.stdout is not None
        address = process.stdout.readline().strip()
        with urllib.request.urlopen(address, timeout=60) as answer:
            assert b"Map of miniature" in answer.read()
        latest = time.monotonic() + 60
        while not opened.exists() and time.monotonic() < latest:
            time.sleep(0.02)
        rest, said = stopped(process)
    assert process.returncode == 130
    assert rest == ""
    assert said.splitlines()[-1] == "vnav: interrupted; what was finished is kept"
    assert opened.read_text().strip() == address
