"""The remaining σ of sets of sensors against their cost, for people: `observer place`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from observer.report.panels import INK, QUIET, colour
from observer.report.pictures import drawn
from observer.report.sensitivity import SHIFT_SAID

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_BY = {
    "all": "heats, field and thermal error together (the geometric mean of their rms σ)",
    "heat": "the rms σ of the heats",
    "field": "the rms σ of the field over the travel",
    "error": "the rms σ of the thermal error over the travel",
}
_SIGMAS = {
    "field, K": ("field_sigma_K", "field_worst_K"),
    "error, µm": ("error_sigma_um", "error_worst_um"),
}
"""The columns of two numbers: rms over the travel, and worst."""


def as_text(result: dict[str, Any]) -> RenderableType:
    """Return the sets laid out for a terminal, the cheapest first, the configured sensors last.

    Args:
        result: The document of `observer place --json`.
    """
    rows = [*result["sets"], result["configured"]]
    shown = [name for name, keys in _SIGMAS.items() if rows[0][keys[0]] is not None]
    heads = ["cost", *(f"{name}, W" for name in rows[0]["heat_sigma_W"]), *shown]
    sigmas, members = (Table(box=None, pad_edge=False, header_style="bold") for _ in range(2))
    for head in heads:
        sigmas.add_column(head, justify="right", overflow="fold")
    members.add_column("cost", justify="right", no_wrap=True)
    members.add_column("sensors")
    for row in rows:
        cost = "now" if row is result["configured"] else f"{row['cost']:g}"
        pairs = [tuple(row[key] for key in _SIGMAS[name]) for name in shown]
        heats = [f"{x:.3g}" for x in row["heat_sigma_W"].values()]
        sigmas.add_row(cost, *heats, *(f"{rms:.3g} ({worst:.3g})" for rms, worst in pairs))
        members.add_row(cost, Text(", ".join(row["names"])))
    return Group(*(Text(line) for line in _sentences(result)), Text(), sigmas, Text(), members)


def _sentences(result: dict[str, Any]) -> list[str]:
    tried = result["tried"]
    searched = (
        f"all {tried} sets were tried" if tried > 1 else "the only set within number and budget was tried"
    )
    if not result["exhaustive"]:
        searched = (
            f"{tried} sets were tried, not all: from those worth their cost, one sensor more, less "
            "or exchanged"
        )
    return [
        f"judged by {_BY[result['by']]}; {searched}",
        f"{SHIFT_SAID}; of field and error as rms over the travel (at its worst place)",
    ]


def write_costs(path: Path, result: dict[str, Any]) -> None:
    """Draw the σ of the sets against their cost, and which sensors they have.

    Args:
        path: The file: .png, .svg or .pdf.
        result: The document of `observer place --json`.

    Raises:
        UserError: The folder cannot be written.
    """
    sets, now = result["sets"], result["configured"]
    shown = [name for name, keys in _SIGMAS.items() if now[keys[0]] is not None]
    names = list(dict.fromkeys(name for one in sets for name in one["names"]))
    with drawn(path, 14.0, 6.0 + 0.28 * len(names)) as figure:
        parts = figure.subfigures(2, 1, squeeze=False, height_ratios=(4.4, 0.9 + 0.28 * len(names)))[:, 0]
        panels = parts[0].subplots(1, 1 + len(shown), squeeze=False)[0]
        _lines(panels[0], result, "heats, W", {n: ("heat_sigma_W", n) for n in now["heat_sigma_W"]})
        for axes, name in zip(panels[1:], shown, strict=True):
            rms, worst = _SIGMAS[name]
            _lines(axes, result, name, {"rms over the travel": (rms,), "worst place": (worst,)})
        _members(parts[1].subplots(), sets, names)


def _lines(axes: Axes, result: dict[str, Any], title: str, keys: dict[str, tuple[str, ...]]) -> None:
    """σ against cost, dashed what the configured sensors leave."""
    from matplotlib.ticker import LogLocator, NullFormatter  # noqa: PLC0415

    costs = [one["cost"] for one in result["sets"]]
    for i, (name, path) in enumerate(keys.items()):
        values = [_at(one, path) for one in result["sets"]]
        axes.plot(costs, values, "o-", ms=5, color=colour(i), label=name)
        axes.axhline(_at(result["configured"], path), color=colour(i), ls="--", lw=1.0)
    axes.set_yscale("log")
    axes.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axes.yaxis.set_major_formatter(lambda value, _: f"{value:g}")
    axes.yaxis.set_minor_formatter(NullFormatter())
    axes.set(title=f"σ of {title}", xlabel="cost (dashed: the configured sensors)")
    axes.legend()


def _at(row: dict[str, Any], path: tuple[str, ...]) -> float:
    value: Any = row
    for key in path:
        value = value[key]
    return float(value)


def _members(axes: Axes, sets: list[dict[str, Any]], names: list[str]) -> None:
    """Which sensors each set has, one column for each set."""
    for i, one in enumerate(sets):
        rows = [names.index(name) for name in one["names"]]
        axes.plot([i] * len(rows), rows, "o", ms=8, color=INK)
        axes.axvline(i, color=QUIET, lw=0.4, zorder=0)
    axes.set_yticks(range(len(names)), names)
    axes.set_xticks(range(len(sets)), [f"{one['cost']:g}" for one in sets])
    axes.set(title="Sensors of each set", xlabel="cost", xlim=(-0.5, max(len(sets), 8) - 0.5))
    axes.set_ylim(len(names) - 0.5, -0.5)
