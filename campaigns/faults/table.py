"""Rows of the table of faults, and how they are shown."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Row:
    """A promise of another trusted daemon, the figure to beat, what was measured, and whether it does."""

    source: str
    promise: str
    figure: str
    measured: str
    met: bool


def as_markdown(rows: list[Row]) -> str:
    """The table as it stands in the documentation."""
    lines = ["| from | promise | figure to beat | measured | met |", "|---|---|---|---|---|"]
    for row in rows:
        verdict = "yes" if row.met else "**no**"
        lines.append(f"| {row.source} | {row.promise} | {row.figure} | {row.measured} | {verdict} |")
    return "\n".join(lines)
