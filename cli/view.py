"""Show a map in a browser."""

import os
import sys
import webbrowser
from pathlib import Path
from threading import Thread

import click

from vnav.cli.logs import is_quiet
from vnav.cli.options import map_argument_or_option
from vnav.cli.say import say

SCREENS = ("DISPLAY", "WAYLAND_DISPLAY", "BROWSER")  # without one, Linux has a browser for text


@click.command()
@map_argument_or_option
@click.option(
    "--port",
    type=click.IntRange(0, 65535),
    default=0,
    show_default="any that is free",
    help="Port of 127.0.0.1 to serve at.",
)
@click.option("--no-browser", is_flag=True, help="Only print the address.")
def view(map_dir: Path, port: int, no_browser: bool) -> None:
    """Show a map in the browser: the page of 'vnav report', with the whole cloud and the surface.

    The page is served to this machine alone until Ctrl-C ends it. Load it again to see what was
    located or planned meanwhile. Of a map on another machine, lead a port here by ssh.

    \b
    vnav view my-map
    vnav view my-map --port 8080 --no-browser
    ssh -t -L 8080:localhost:8080 robot vnav view my-map --port 8080 --no-browser
    """
    from vnav.api.map import open_map

    with open_map(map_dir).server(port) as server:
        click.echo(server.address)
        sys.stdout.flush()
        if not is_quiet():
            say("vnav: Ctrl-C ends it", err=True)
        if not no_browser and _has_screen():
            Thread(target=webbrowser.open, args=(server.address,), daemon=True).start()
        server.serve_forever()


def _has_screen() -> bool:
    return sys.platform != "linux" or any(os.environ.get(name) for name in SCREENS)
