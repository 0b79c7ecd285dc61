"""The campaign of heated rods: what a search answers of each. Rows that are there are not run again."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from rich.console import Console

from campaigns.resumable import Rows, go_on, read_rows, show
from tests.truth.heated_rod import HIDDEN, draw, write

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


def tried(what: tuple[str, int]) -> Rows:
    """One rod's row."""
    from observer import discover

    hidden, seed = what
    with TemporaryDirectory() as folder:
        log = write(draw(seed, hidden), seed, Path(folder))
        result = discover(Path(folder) / "config.toml", log).document
    family = result.get("family") or {}
    named = " ".join(f"{e['kind']}@{e['target']}" for e in result["effects"])
    several = " | ".join(" ".join(names) for names in result["alternatives"])
    outcome, family_name = outcome_of(hidden, result), family.get("name", "")
    cells = (hidden, seed, outcome, result["verdict"], named, several, family_name, result["reason"])
    return [dict(zip(COLUMNS, map(str, cells), strict=True))]


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
    done = {(row["hidden"], int(row["seed"])) for row in read_rows(RESULTS)}
    seeds = range(FIRST_SEED, FIRST_SEED + RODS)
    todo = [(hidden, seed) for seed in seeds for hidden in HIDDEN if (hidden, seed) not in done]
    go_on(todo, tried, RESULTS, Console(stderr=True))
    show(PAGE, table(read_rows(RESULTS)), MARKS)


if __name__ == "__main__":
    main()
