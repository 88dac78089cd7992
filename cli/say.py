"""What a person reads, on a terminal that no file's or capture's name can command."""

import click

CONTROL = {c: f"\\x{c:02x}" for c in (*range(32), *range(127, 160)) if chr(c) not in "\n\t"}


def printable(text: str) -> str:
    """Text without control characters: they are shown by their numbers."""
    return text.translate(CONTROL)


def say(text: object, *, err: bool = False) -> None:
    """Print lines of text, on stderr if so wanted."""
    click.echo(printable(str(text)), err=err)
