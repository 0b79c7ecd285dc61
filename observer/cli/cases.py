"""How machines in one case or several are printed for people."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rich.console import RenderableType

    from observer.library.cases import CaseFigures


def case_as_table(case: CaseFigures) -> RenderableType:
    """One case, from top to bottom."""
    return cases_as_table([case])


def cases_as_table(cases: Sequence[CaseFigures]) -> RenderableType:
    """Cases side by side, a column each."""
    from rich.table import Table

    table = Table("")
    for case in cases:
        table.add_column(case.name, justify="right")

    def row(title: str, values: Sequence[float | None], form: str) -> None:
        table.add_row(title, *("–" if value is None else format(value, form) for value in values))

    for source in dict.fromkeys(name for case in cases for name in case.heat_W):
        row(f"heat of {source}, W", [case.heat_W.get(source) for case in cases], ".2f")
    row("all heats, W", [sum(case.heat_W.values()) for case in cases], ".2f")
    for place in dict.fromkeys(name for case in cases for name in case.temperature_degC):
        row(f"{place}, °C", [case.temperature_degC.get(place) for case in cases], ".2f")
    row("warmest place of the screw, °C", [float(case.field_degC.max()) for case in cases], ".2f")
    row("coldest place of the screw, °C", [float(case.field_degC.min()) for case in cases], ".2f")
    if any(len(case.error_um) for case in cases):
        row("largest thermal error in the travel, µm", [case.largest_error_um for case in cases], ".2f")
        row("  at, mm", [1000.0 * case.largest_at_m for case in cases], ".0f")
        row("thermal error at the right end, µm", [_last(case) for case in cases], ".2f")
        row("axial force, N", [abs(case.force_N) and case.force_N for case in cases], ".0f")
    if any(case.slowest_s is not None for case in cases):
        hours = [None if case.slowest_s is None else case.slowest_s / 60.0 for case in cases]
        row("slowest time constant, min", hours, ".0f")
    return table


def _last(case: CaseFigures) -> float | None:
    return float(case.error_um[-1]) if len(case.error_um) else None
