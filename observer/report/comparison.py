"""The picture of machines side by side: temperature and thermal error along the screw, heats, and force."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from observer.frames import FloatArray
from observer.report.appearance import MM_PER_M
from observer.report.panels import INK, QUIET, colour, ordered_colours

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


class DrawnCase(Protocol):
    """The drawn data of a case, as `library.cases.CaseFigures` has them.

    Attributes:
        name: The variant's name.
        position_m: Places along the screw, (g,).
        field_degC: Temperature at these, (g,).
        error_um: Thermal error at these, (g,); empty without an expansion coefficient.
        heat_W: By source.
        temperature_degC: By the names of sensors and nodes.
        force_N: Axial force, tension positive; 0 for a free screw.
    """

    @property
    def name(self) -> str: ...  # noqa: D102
    @property
    def position_m(self) -> FloatArray: ...  # noqa: D102
    @property
    def field_degC(self) -> FloatArray: ...  # noqa: D102
    @property
    def error_um(self) -> FloatArray: ...  # noqa: D102
    @property
    def heat_W(self) -> Mapping[str, float]: ...  # noqa: D102
    @property
    def temperature_degC(self) -> Mapping[str, float]: ...  # noqa: D102
    @property
    def force_N(self) -> float: ...  # noqa: D102


_DISTINCT, _ROOM, _MOST_PLACES = 7, 4, 24
_DASHES: tuple[Any, ...] = ("-", (0, (5, 2)), (0, (1.5, 1.5)))
_KEY_WIDTH = 1.45  # how much wider than the bars, for the key


def draw_cases(figure: Figure, cases: Sequence[DrawnCase], title: str, words: str) -> list[Axes]:
    """Draw cases of one machine: temperature, thermal error, heats, and axial force.

    Without any force the last panel shows the temperatures of sensors and nodes.

    Args:
        figure: An empty figure.
        cases: At least one; more than seven get colours of rising lightness.
        title: Machine and axis.
        words: What the figures are: of a steady state or of a cycle.

    Returns:
        The axes of field, error, heats, and force or temperatures.
    """
    figure.set_layout_engine("constrained", rect=(0.0, 0.0, 1.0, 0.955), hspace=0.05, wspace=0.04)
    (field, error), (heats, force) = figure.subplots(2, 2, gridspec_kw={"width_ratios": (1.2, 1.0)})
    inks = [colour(i) for i in range(len(cases))] if len(cases) <= _DISTINCT else ordered_colours(len(cases))
    for i, (case, ink) in enumerate(zip(cases, inks, strict=True)):
        width = 1.6 + 3.0 * (1.0 - (i + 1) / len(cases))  # so that equal curves show
        style: dict[str, Any] = {"color": ink, "lw": width, "ls": _DASHES[i % len(_DASHES)]}
        field.plot(MM_PER_M * case.position_m, case.field_degC, label=case.name, **style)
        if len(case.error_um):
            error.plot(MM_PER_M * case.position_m, case.error_um, **style)
    field.set(title="Temperature of the screw", xlabel="position, mm", ylabel="°C")
    error.set(title="Thermal error", xlabel="position, mm", ylabel="µm")
    error.axhline(0.0, color=QUIET, lw=0.8)
    _stacked(heats, cases)
    if any(case.force_N for case in cases):
        _bars(force, cases, inks)
    else:
        _temperatures(force, cases, inks)
    if len(cases) > 1:
        figure.legend(*field.get_legend_handles_labels(), loc="outside lower center", ncols=4)
    figure.text(0.01, 0.987, title, ha="left", va="top", fontsize=17, fontweight="bold")
    figure.text(0.99, 0.983, words, ha="right", va="top", color=QUIET)
    return [field, error, heats, force]


def _named(axes: Axes, cases: Sequence[DrawnCase]) -> FloatArray:
    """Rows with the names of the cases, the first at the top."""
    rows = -np.arange(float(len(cases)))
    axes.set_ylim(-max(len(cases), _ROOM) + 0.4, 0.6)
    axes.set_yticks(rows, [case.name for case in cases])
    axes.tick_params(axis="y", length=0, labelcolor=INK)
    axes.grid(visible=False, axis="y")
    return rows


def _stacked(axes: Axes, cases: Sequence[DrawnCase]) -> None:
    """The heats of each case, one after the other."""
    rows, left = _named(axes, cases), np.zeros(len(cases))
    sources = list(dict.fromkeys(name for case in cases for name in case.heat_W))
    for i, source in enumerate(sources):
        width = np.array([case.heat_W.get(source, 0.0) for case in cases])
        axes.barh(rows, width, left=left, color=colour(i), label=source, height=0.6)
        left += width
    axes.set(title="Heat by source", xlabel="W")
    axes.set_xlim(right=_KEY_WIDTH * max(float(left.max()), 1e-9))
    axes.legend(loc="upper right")


def _temperatures(axes: Axes, cases: Sequence[DrawnCase], inks: Sequence[object]) -> None:
    """The temperatures of sensors and nodes of each case."""
    places = list(dict.fromkeys(name for case in cases for name in case.temperature_degC))[:_MOST_PLACES]
    rows = {place: -float(i) for i, place in enumerate(places)}
    for case, ink in zip(cases, inks, strict=True):
        shown = [place for place in places if place in case.temperature_degC]
        values = [case.temperature_degC[place] for place in shown]
        axes.plot(values, [rows[place] for place in shown], "o", ms=7, color=ink)
    axes.set_yticks(list(rows.values()), places)
    axes.tick_params(axis="y", length=0, labelcolor=INK)
    axes.set_ylim(-max(len(places), _ROOM) + 0.4, 0.6)
    axes.set(title="Sensors and nodes (no axial force arises)", xlabel="°C")


def _bars(axes: Axes, cases: Sequence[DrawnCase], inks: Sequence[object]) -> None:
    """The axial force of each case."""
    rows = _named(axes, cases)
    axes.barh(rows, [case.force_N / 1000.0 for case in cases], color=inks, height=0.6)
    axes.axvline(0.0, color=QUIET, lw=0.8)
    axes.set(title="Axial force in the screw, tension positive", xlabel="kN")
