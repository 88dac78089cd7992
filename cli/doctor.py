"""The installation check: a table, or JSON; exit code 1 where something is broken."""

import dataclasses
import json

import click


@click.command()
@click.option("--json", "as_json", is_flag=True, help="Print the checks as one JSON object.")
def doctor(as_json: bool) -> int:
    """Check the installation: versions, native libraries, self-tests, memory and cores.

    \b
    vnav doctor
    vnav doctor --json
    """
    from vnav.doctor import examine

    checks = examine()
    broken = [check for check in checks if not check.ok]
    if as_json:
        rows = [dataclasses.asdict(check) for check in checks]
        click.echo(json.dumps({"ok": not broken, "checks": rows}, indent=1))
        return int(bool(broken))
    width = max(len(check.name) for check in checks)
    for check in checks:
        click.echo(f"{'ok' if check.ok else 'BROKEN':8}{check.name:{width + 2}}{check.found}")
        if check.mend:
            click.echo(f"{'':{width + 10}}mend: {check.mend}")
    click.echo(f"{len(broken)} of {len(checks)} broken" if broken else "everything works")
    return int(bool(broken))
