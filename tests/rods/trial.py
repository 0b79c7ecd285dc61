"""The campaign of heated rods: what a search answers of each. Rows that are there are not run again."""

from __future__ import annotations

import csv
import sys
from collections.abc import Mapping
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from tests.campaign.__main__ import with_tables
from tests.rods.truth import HIDDEN, draw, write

FIRST_SEED = 9500
RODS = 6
DOCS = Path(__file__).parents[2] / "docs"
RESULTS, PAGE = DOCS / "campaign" / "rods.csv", DOCS / "discovery.md"
MARKS = ("<!-- heated rods, written by make rods-campaign -->", "<!-- end of heated rods -->")
COLUMNS = ("hidden", "seed", "outcome", "verdict", "named", "alternatives", "family", "reason")
NAMES = {"film": "surface_convection", "radiation": "radiation", "block": "attached_mass at left"}


def outcome_of(hidden: str, result: Mapping[str, Any]) -> str:
    """What an answer amounts to: right, in the set, a doubt (none, unknown, …), or wrong."""
    named = [e["kind"] + (f" at {e['target']}" if e["target"] else "") for e in result["effects"]]
    true = [NAMES[hidden]] if hidden in NAMES else []
    verdict = str(result["verdict"])
    if verdict == "named":
        return "right" if named == true else "wrong"
    if verdict == "ambiguous":
        return "in the set" if true in result["alternatives"] else "wrong"
    if not true:
        return {"none": "right", "not_identifiable": "right"}.get(verdict, verdict)
    return verdict


def tried(what: tuple[str, int]) -> dict[str, str]:
    """One rod's row."""
    from observer.app import discover

    hidden, seed = what
    with TemporaryDirectory() as folder:
        log = write(draw(seed, hidden), seed, Path(folder))
        found = Path(folder) / "found"
        config = Path(folder) / "config.toml"
        _, result = discover(config, [log], found, lambda _stage, _part: None, report=False)
    family = result.get("family") or {}
    named = " ".join(f"{e['kind']}@{e['target']}" for e in result["effects"])
    several = " | ".join(" ".join(names) for names in result["alternatives"])
    outcome, told = outcome_of(hidden, result), family.get("name", "")
    cells = (hidden, seed, outcome, result["verdict"], named, several, told, result["reason"])
    return dict(zip(COLUMNS, map(str, cells), strict=True))


def table(rows: list[dict[str, str]]) -> str:
    """The campaign, a line for each thing hidden."""
    outcomes = ("right", "in the set", "none", "not_identifiable", "unknown", "wrong")
    lines = [f"| hidden | rods | {' | '.join(outcomes)} |", f"|---|---|{'---|' * len(outcomes)}"]
    for hidden in HIDDEN:
        own = [row["outcome"] for row in rows if row["hidden"] == hidden]
        counts = " | ".join(str(own.count(outcome)) for outcome in outcomes)
        lines.append(f"| {hidden} | {len(own)} | {counts} |")
    return "\n".join(lines)


def main() -> None:
    """Run what is missing, two at a time, and write the table into the page."""
    rows = []
    if RESULTS.exists():
        with RESULTS.open(newline="", encoding="utf-8") as file:
            rows = list(csv.DictReader(file))
    done = {(row["hidden"], int(row["seed"])) for row in rows}
    seeds = range(FIRST_SEED, FIRST_SEED + RODS)
    todo = [(hidden, seed) for seed in seeds for hidden in HIDDEN if (hidden, seed) not in done]
    with ProcessPoolExecutor(2) as pool:
        for count, row in enumerate(pool.map(tried, todo), start=1):
            rows.append(row)
            with RESULTS.open("w", newline="", encoding="utf-8") as file:
                writer = csv.DictWriter(file, COLUMNS, lineterminator="\n")
                writer.writeheader()
                writer.writerows(rows)
            sys.stderr.write(f"\r{count} of {len(todo)} rods")
    sys.stderr.write("\n")
    page = with_tables(PAGE.read_text(encoding="utf-8"), table(rows), MARKS)
    PAGE.write_text(page, encoding="utf-8")


if __name__ == "__main__":
    main()
