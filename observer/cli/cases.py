"""Prints one or several cases of machines for people."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rich.console import RenderableType
    from rich.table import Table

    from observer.library.cases import CaseFigures
    from observer.library.comparing import Comparison, LeftUnknown
    from observer.model.rod.mountings import MountedScrew


_ROOM = 30
"""Names up to this many characters are printed side by side; longer ones are numbered."""


def case_as_table(case: CaseFigures) -> RenderableType:
    """One case, from top to bottom."""
    return cases_as_table([case])


def cases_as_table(cases: Sequence[CaseFigures], unknown: Sequence[LeftUnknown | None] = ()) -> Table:
    """Cases side by side, a column each."""
    from rich.table import Table

    table = Table()
    table.add_column("", no_wrap=True)
    names = [case.name for case in cases]
    if sum(map(len, names)) > _ROOM:
        table.title, table.title_justify = (
            "\n".join(f"{i}  {name}" for i, name in enumerate(names, 1)),
            "left",
        )
        names = [str(i) for i in range(1, len(names) + 1)]
    for name in names:
        table.add_column(name, justify="right")

    def row(title: str, values: Sequence[float | None], form: str) -> None:
        table.add_row(title, *("–" if value is None else format(value, form) for value in values))

    for source in dict.fromkeys(name for case in cases for name in case.heat_W):
        row(f"heat of {source}, W", [case.heat_W.get(source) for case in cases], ".2f")
    row("all heats, W", [sum(case.heat_W.values()) for case in cases], ".2f")
    for place in dict.fromkeys(name for case in cases for name in case.temperature_degC):
        row(f"{place}, °C", [case.temperature_degC.get(place) for case in cases], ".2f")
    row("warmest of the screw, °C", [float(case.field_degC.max()) for case in cases], ".2f")
    row("coldest of the screw, °C", [float(case.field_degC.min()) for case in cases], ".2f")
    if any(len(case.error_um) for case in cases):
        row("largest error, µm", [case.largest_error_um for case in cases], ".2f")
        row("  at, mm", [1000.0 * case.largest_at_m for case in cases], ".0f")
        row("error at the right, µm", [_last(case) for case in cases], ".2f")
        row("axial force, N", [round(case.force_N) or 0 for case in cases], ".0f")
    row("Biot number", [case.biot for case in cases], ".3f")
    if any(case.slowest_s is not None for case in cases):
        minutes = [None if case.slowest_s is None else case.slowest_s / 60.0 for case in cases]
        row("time constant, min", minutes, ".0f")
    for source in dict.fromkeys(name for left in unknown if left is not None for name in left.heat_W):
        row(f"σ of heat of {source}, W", [left and left.heat_W.get(source) for left in unknown], ".3f")
    if any(unknown):
        row("σ of the field, K", [left and left.field_K for left in unknown], ".3f")
        row("σ of the error, µm", [left and left.error_um for left in unknown], ".3f")
    return table


def _last(case: CaseFigures) -> float | None:
    return float(case.error_um[-1]) if len(case.error_um) else None


def comparison_as_text(found: Comparison) -> RenderableType:
    """Variants side by side, then the best way to mount each."""
    from rich.console import Group

    unknown = [found.unknown.get(case.name) for case in found.cases] if found.unknown else ()
    alike: dict[tuple[MountedScrew, ...], list[str]] = {}
    for name, best in found.mounted.items():
        alike.setdefault(tuple(best), []).append(name)
    tables = [_mounted_as_table("; ".join(names), best) for best, names in alike.items()]
    return Group(cases_as_table(found.cases, unknown), *tables)


def _mounted_as_table(name: str, best: Sequence[MountedScrew]) -> Table:
    """The best of each mounting of a variant, the smallest error first."""
    from rich.table import Table

    table = Table(
        "mounting", "first", "preload, N", "gap, µm", "error, µm", "at, mm", "force, N",
        title=f"least error of {name}", title_justify="left",
    )  # fmt: skip
    for one in best:
        held = one.supports
        tuned = held.mounting == "L-III"
        table.add_row(
            held.mounting, held.first, f"{held.preload_N:.0f}" if tuned else "–",
            f"{1e6 * held.gap_m:.1f}" if tuned else "–", f"{one.error_um:.2f}",
            f"{1000.0 * one.position_m:.0f}", f"{round(one.force_N) or 0}",
        )  # fmt: skip
    return table
