"""What `vnav evaluate` found on hard versions, held against the clean captures.

    python benchmarks/hard_table.py DIR [--record]

DIR holds the versions of hard_versions.py, in hard/ the results of its suite hard.toml (all of
them), in seeds/ those of seeds.toml (the clean ones, several seeds). Exit code 1 where a usable
frame has no pose, the ATE is more than twice the clean one, or a spread is too wide.
"""

import argparse
import csv
import sys
from pathlib import Path
from statistics import median

from recording import Measurement, add_record_option, missed, record, table

TIMES_CLEAN, SPREAD = 2.0, 0.2
DROPPED = "dropped_2_seed_"
SHOWN = {
    "every_third": "every third frame only",
    "dropped_20": "20 % of the frames dropped",
    "blurred": "motion blur of 9 px on every tenth",
    "exposed": "exposure jumping by 2",
    "lamp": "a lamp on the camera",
    "half_depth": "half of all depth missing",
    "black_first": "first frame black",
    "rolled": "rolled by 90 degrees",
    "cut": "3 s cut out",
}

Row = dict[str, str]


def rows_of(folder: Path) -> list[Row]:
    """Lines of a results.csv, with capture and version apart."""
    with (folder / "results.csv").open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    for row in rows:
        row["capture"], _, row["version"] = row["sequence"].partition("/")
    return rows


def usable(versions: Path, row: Row) -> int:
    """How many of a version's frames must have a pose."""
    path = versions / row["sequence"].replace("/", "_") / "unusable.txt"
    return int(row["frames"]) - len(path.read_text("utf-8").splitlines())


def compare(rows: list[Row], versions: Path) -> list[Measurement]:
    """How each version that was mapped stands to the clean one, and what is wanted of it."""
    clean = {r["capture"]: float(r["ate_rmse_m"]) for r in rows if r["version"] == "clean"}
    found = []
    for row in rows:
        on, what = row["capture"], SHOWN.get(row["version"], row["version"])
        wanted, ate_m = usable(versions, row), float(row["ate_rmse_m"] or "nan")
        limit, times = f"at least {wanted}", f"at most {TIMES_CLEAN:g}"
        found += [
            Measurement(on, what, "usable frames", wanted),
            Measurement(on, what, "frames with a pose", int(row["posed"]), "", limit),
            Measurement(on, what, "ATE RMSE", ate_m, "m"),
            Measurement(on, what, "ATE, of the clean", ate_m / clean[on], "", times),
        ]
    return found


def spreads(rows: list[Row], what: str) -> list[Measurement]:
    """How far runs of each capture lie apart."""
    found = []
    for capture in dict.fromkeys(row["capture"] for row in rows):
        ates_m = [float(r["ate_rmse_m"] or "nan") for r in rows if r["capture"] == capture]
        middle_m = median(ates_m)
        share = (max(ates_m) - min(ates_m)) / middle_m
        print(
            f"{capture}, {len(ates_m)} {what}: ATE {min(ates_m):.4f} to {max(ates_m):.4f} m,"
            f" {share:.0%} of the median"
        )
        name, limit = f"{len(ates_m)} {what}, the median", f"at most {100 * SPREAD:g}"
        found.append(Measurement(capture, name, "ATE RMSE", middle_m, "m"))
        found.append(Measurement(capture, name, "spread of ATE", 100 * share, "%", limit))
    return found


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("versions", type=Path, metavar="DIR")
    add_record_option(parser)
    asked = parser.parse_args(arguments)
    rows = rows_of(asked.versions / "hard")
    failed, mapped = ([r for r in rows if (r["state"] == "ok") == ok] for ok in (False, True))
    seeds = [r for r in rows_of(asked.versions / "seeds") if r["state"] == "ok"]
    found = compare(mapped, asked.versions)
    dropped = [r for r in mapped if r["version"].startswith(DROPPED)]
    found += spreads(dropped, "runs without 2 % of the frames")
    found += spreads(seeds, "seeds")
    print(f"\n{table(found)}\n")
    for row in failed:
        print(f"{row['sequence']}: failed, {row['reason']}")
    for row in (row for row in mapped if row["lost"]):
        print(f"{row['sequence']}: frames without a pose: {row['lost']}")
    for capture in dict.fromkeys(row["capture"] for row in mapped) if asked.record else ():
        own = [m for m in found if m.on == capture]
        record(f"hard_{capture}", "how robust", own, arguments)
    return int(bool(failed or missed(found)))


if __name__ == "__main__":
    sys.exit(main())
