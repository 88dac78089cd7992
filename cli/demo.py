"""The whole chain on a rendered apartment."""

from pathlib import Path

import click

from vnav.cli.options import console_progress
from vnav.cli.summary import show


@click.command()
@click.option(
    "--out",
    type=click.Path(path_type=Path),
    default=Path("demo"),
    show_default=True,
    help="Folder for the map and the pictures.",
)
def demo(out: Path) -> int:
    """Render an apartment, map it, find a photo in it, plan a path to where another was taken.

    Then say how true the answers are. The rendered capture is kept in $XDG_CACHE_HOME/vnav. Exit
    code 3: a photo was not located, or there is no path.

    \b
    vnav demo
    vnav demo --out somewhere/else
    """
    from vnav.config import Config
    from vnav.localisation.verdict.answer import summary
    from vnav.reporting.plan_text import summary as plan_summary
    from vnav.synthetic import demo as chain

    done = chain.run(out, Config(), progress=console_progress())
    show(done.reports)
    start, goal = done.ends
    click.echo("\n" + summary(start))
    for line in plan_summary(done.path, str(start.path), str(goal.path)):
        click.echo(line)
    click.echo("\nagainst the truth")
    for line in chain.truth(done):
        click.echo(line)
    click.echo(f"\ncapture   {done.capture}")
    click.echo(f"map       {out / 'map'}")
    click.echo(f"pictures  {out / 'path.png'}, {out / 'photo.jpg'}")
    click.echo(f"report    {out / 'map' / 'reports' / 'report.html'}")
    return 0 if done.succeeded else 3
