"""Prints one or several cases of machines for people."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from rich.console import Console, ConsoleOptions, RenderableType
    from rich.table import Table

    from observer.library.cases import CaseFigures
    from observer.library.comparing import Comparison, LeftUnknown
    from observer.model.rod.mountings import MountedScrew


_ROOM = 30
"""Names up to this many characters are printed side by side; longer ones are numbered."""
_BORDER = 3
"""How much wider a column of a table is than its text."""


def case_as_table(case: CaseFigures) -> RenderableType:
    """Return one case as a table for a terminal, from top to bottom."""
    return cases_as_table([case])


def cases_as_table(
    cases: Sequence[CaseFigures], unknown: Sequence[LeftUnknown | None] = ()
) -> RenderableType:
    """Return cases side by side, a column each, in as many tables as the width of the terminal needs.

    Args:
        cases: At least one. Long names are listed above and replaced by numbers.
        unknown: The σ that remain, in the same order, None for a case without; empty for none.
    """
    names = [case.name for case in cases]
    captions: list[str] = []
    if sum(map(len, names)) > _ROOM:
        captions = [f"{i}  {name}" for i, name in enumerate(names, 1)]
        names = [str(i) for i in range(1, len(names) + 1)]
    return _SideBySide(captions, names, list(_rows(cases, unknown)))


class _SideBySide(NamedTuple):
    """Columns under names, and sentences above them; rows have a title and a text for each column."""

    captions: Sequence[str]
    names: Sequence[str]
    rows: Sequence[tuple[str, list[str]]]

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> Iterator[RenderableType]:
        from rich.table import Table
        from rich.text import Text

        yield from map(Text, self.captions)
        room = options.max_width - max(len(title) for title, _ in self.rows) - _BORDER - 1
        columns = [[name, *(cells[i] for _, cells in self.rows)] for i, name in enumerate(self.names)]
        wide = [max(map(len, column)) + _BORDER for column in columns]
        first = 0
        while first < len(columns):
            last = first + 1
            while last < len(columns) and sum(wide[first : last + 1]) <= room:
                last += 1
            table = Table()
            table.add_column("", no_wrap=True)
            for name in self.names[first:last]:
                table.add_column(name, justify="right", overflow="fold")
            for title, cells in self.rows:
                table.add_row(title, *cells[first:last])
            yield table
            first = last


def _rows(
    cases: Sequence[CaseFigures], unknown: Sequence[LeftUnknown | None]
) -> Iterator[tuple[str, list[str]]]:
    """Yield the rows of the table: a title, and a text for each case."""

    def row(title: str, values: Sequence[float | None], form: str) -> tuple[str, list[str]]:
        return title, ["–" if value is None else format(value, form) for value in values]

    for source in dict.fromkeys(name for case in cases for name in case.heat_W):
        yield row(f"heat of {source}, W", [case.heat_W.get(source) for case in cases], ".2f")
    yield row("all heats, W", [sum(case.heat_W.values()) for case in cases], ".2f")
    for place in dict.fromkeys(name for case in cases for name in case.temperature_degC):
        yield row(f"{place}, °C", [case.temperature_degC.get(place) for case in cases], ".2f")
    yield row("warmest of the screw, °C", [case.warmest_degC for case in cases], ".2f")
    yield row("coldest of the screw, °C", [case.coldest_degC for case in cases], ".2f")
    if any(len(case.error_um) for case in cases):
        yield row("largest error, µm", [case.largest_error_um for case in cases], ".2f")
        yield row("  at, mm", [1000.0 * case.largest_at_m for case in cases], ".0f")
        yield row("error at the right, µm", [_last(case) for case in cases], ".2f")
        yield row("axial force, N", [round(case.force_N) or 0 for case in cases], ".0f")
    yield row("Biot number", [case.biot for case in cases], ".3f")
    if any(case.slowest_s is not None for case in cases):
        minutes = [None if case.slowest_s is None else case.slowest_s / 60.0 for case in cases]
        yield row("time constant, min", minutes, ".0f")
    for source in dict.fromkeys(name for left in unknown if left is not None for name in left.heat_W):
        yield row(f"σ of heat of {source}, W", [left and left.heat_W.get(source) for left in unknown], ".3f")
    if any(unknown):
        yield row("σ of the field, K", [left and left.field_K for left in unknown], ".3f")
        yield row("σ of the error, µm", [left and left.error_um for left in unknown], ".3f")


def _last(case: CaseFigures) -> float | None:
    return float(case.error_um[-1]) if len(case.error_um) else None


def comparison_as_text(comparison: Comparison) -> RenderableType:
    """Return variants side by side, then the best way to mount each; variants with the same result share a
    table.
    """
    from rich.console import Group

    unknown = [comparison.unknown.get(case.name) for case in comparison.cases] if comparison.unknown else ()
    alike: dict[tuple[MountedScrew, ...], list[str]] = {}
    for name, best in comparison.mounted.items():
        alike.setdefault(tuple(best), []).append(name)
    tables = [_mounted_as_table("; ".join(names), best) for best, names in alike.items()]
    return Group(cases_as_table(comparison.cases, unknown), *tables)


def _mounted_as_table(name: str, best: Sequence[MountedScrew]) -> Table:
    """The best of each mounting of a variant, the smallest error first."""
    from rich.table import Table

    table = Table(
        "mounting", "first", "preload, N", "gap, µm", "error, µm", "at, mm", "force, N",
        title=f"least error of {name}", title_justify="left",
    )  # fmt: skip
    for one in best:
        supports = one.supports
        tuned = supports.mounting == "L-III"
        table.add_row(
            supports.mounting, supports.first, f"{supports.preload_N:.0f}" if tuned else "–",
            f"{1e6 * supports.gap_m:.1f}" if tuned else "–", f"{one.error_um:.2f}",
            f"{1000.0 * one.position_m:.0f}", f"{round(one.force_N) or 0}",
        )  # fmt: skip
    return table
