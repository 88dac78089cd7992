"""What `vnav evaluate` found on hard versions, held against the clean captures.

    python benchmarks/hard_table.py DIR

DIR holds the versions of hard_versions.py, in hard/ the results of its suite hard.toml (all of
them), in seeds/ those of seeds.toml (the clean ones, several seeds). Exit code 1 where a usable
frame has no pose, the ATE is more than twice the clean one, or a spread is too wide.
"""

import argparse
import csv
import sys
from pathlib import Path
from statistics import median

TIMES_CLEAN, SPREAD = 2.0, 0.2
DROPPED = "dropped_2_seed_"

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


def compare(rows: list[Row], versions: Path) -> bool:
    """Print a line for each version; whether all of them are as they should be."""
    clean = {r["capture"]: float(r["ate_rmse_m"]) for r in rows if r["version"] == "clean"}
    print("| version | posed | usable | ATE | / clean | | lost |\n|---|---|---|---|---|---|---|")
    good = True
    for row in rows:
        if row["state"] != "ok":
            print(f"| {row['sequence']} | | | | | failed | {row['reason']} |")
            good = False
            continue
        wanted = usable(versions, row)
        ate_m = float(row["ate_rmse_m"] or "nan")
        ratio = ate_m / clean[row["capture"]]
        well = int(row["posed"]) >= wanted and ratio <= TIMES_CLEAN
        good &= well
        print(
            f"| {row['sequence']} | {row['posed']} | {wanted} | {ate_m:.4f} m | {ratio:.2f}"
            f" | {'' if well else 'missed'} | {row['lost']} |"
        )
    return good


def spreads(rows: list[Row], what: str) -> bool:
    """Print how far runs of one capture lie apart; whether none is too wide."""
    good = True
    for capture in dict.fromkeys(row["capture"] for row in rows):
        ates_m = [float(r["ate_rmse_m"] or "nan") for r in rows if r["capture"] == capture]
        middle = median(ates_m)
        share = (max(ates_m) - min(ates_m)) / middle
        good &= share <= SPREAD
        print(
            f"{capture}, {len(ates_m)} {what}: ATE {min(ates_m):.4f} to {max(ates_m):.4f} m,"
            f" {share:.0%} of the median (wanted: at most {SPREAD:.0%})"
        )
    return good


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("versions", type=Path, metavar="DIR")
    folder = parser.parse_args(arguments).versions
    rows = rows_of(folder / "hard")
    good = compare(rows, folder)
    print()
    dropped = [r for r in rows if r["version"].startswith(DROPPED) and r["state"] == "ok"]
    good &= spreads(dropped, "runs without 2 % of the frames")
    good &= spreads([r for r in rows_of(folder / "seeds") if r["state"] == "ok"], "seeds")
    return int(not good)


if __name__ == "__main__":
    sys.exit(main())
