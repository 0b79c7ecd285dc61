"""Temperature and thermal error along the screw at some times of a log, beside its heats: a report."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np

from observer.errors import UserError
from observer.estimate.pipeline import MachineModel
from observer.estimators.packing import IntArray
from observer.files.logs import Log
from observer.files.writer import write_log
from observer.frames import FloatArray
from observer.installation import Installation
from observer.library.replaying import Estimates, estimates_of_log
from observer.library.signals import SignalTable
from observer.report.profiles import Profiles, draw_profiles

MOST_PLACES = 400


class ReportGrid(NamedTuple):
    """The grid of a report.

    Attributes:
        every_m: Distance of the positions over the first nut's stroke, or the screw without one; None for
            those of `[output]`.
        every_s: Interval of the times.
    """

    every_m: float | None = None
    every_s: float = 600.0

    def check(self) -> None:
        """Refuse an interval of times that is not positive.

        Raises:
            UserError: `every_s` is 0, negative or NaN.
        """
        if not self.every_s > 0.0:
            raise UserError(f"--every-min {self.every_s / 60.0:g}: give a number above 0")


def write_report(report: Profiles, folder: Path) -> None:
    """Write `report.csv` and `report.png` into a folder.

    Args:
        report: t times at g places.
        folder: An existing folder. `report.csv` gets t g rows: time, place, temperature, thermal error and
            heats, each with σ.
    """
    from observer.report.pictures import written

    g = len(report.position_m)
    columns = {
        "position_m": np.tile(report.position_m, len(report.time_s)),
        "field_degC": report.field_degC.ravel(),
        "field_sigma_K": report.field_sigma_K.ravel(),
        "error_um": report.error_um.ravel(),
        "error_sigma_um": report.error_sigma_um.ravel(),
    }
    for j, name in enumerate(report.names):
        columns[f"heat_{name}_W"] = np.repeat(report.heat_W[:, j], g)
        columns[f"heat_{name}_sigma_W"] = np.repeat(report.heat_sigma_W[:, j], g)
    write_log(folder / "report.csv", np.repeat(report.time_s, g), columns)
    with written(folder / "report.png") as figure:
        draw_profiles(figure, report)


def profiles(log: Log, config: Installation, heats: SignalTable, grid: ReportGrid) -> Profiles:
    """Return the profiles of a log: `heats` from all of it, temperatures and thermal error from its
    replay.

    Args:
        log: The log, with the configuration's channels.
        config: The machine.
        heats: Result of `identified_heats` for this log, with the same rows as a replay.
        grid: Places and times. Times count from the first estimate, which itself is left out; a shorter log
            gets its last row.

    Raises:
        UserError: The places are impossible.
        LogError: The log cannot be replayed.
    """
    places_m = places(config, grid.every_m)
    if places_m is not None:
        output = config.output.model_copy(update={"positions_m": places_m})
        config = config.model_copy(update={"output": output})
    machine = MachineModel.of(config, learns=True)
    estimates = estimates_of_log(log, config, machine)
    times_s = estimates.time_s
    since_s = times_s - times_s[0]
    rows = np.unique(np.searchsorted(since_s, np.arange(0.0, since_s[-1] + 1e-6, grid.every_s)))[1:]
    rows = rows[rows < len(times_s)] if len(rows) else np.array([len(times_s) - 1])
    layout = machine.plant.layout
    mm = [f"{1000 * x:.10g}" for x in layout.position_m]
    heat_W, heat_sigma_W = (
        np.column_stack([heats[f"heat_{name}_{unit}"][rows] for name in layout.sources])
        for unit in ("W", "sigma_W")
    )
    return Profiles(
        time_s=times_s[rows],
        position_m=layout.position_m,
        field_degC=_along(estimates, mm, rows, "field", "degC"),
        field_sigma_K=_along(estimates, mm, rows, "field", "sigma_K"),
        error_um=_along(estimates, mm, rows, "error", "um"),
        error_sigma_um=_along(estimates, mm, rows, "error", "sigma_um"),
        names=layout.sources,
        heat_W=heat_W,
        heat_sigma_W=heat_sigma_W,
    )


def _along(estimates: Estimates, mm: list[str], rows: IntArray, kind: str, unit: str) -> FloatArray:
    """Return one kind of column at all places and the given rows, (t, g); NaN without that column."""
    names = [f"{kind}_{at}_{unit}" for at in mm]
    if names[0] not in estimates.signals:
        return np.full((len(rows), len(mm)), np.nan)
    return np.column_stack([estimates[name][rows] for name in names])


def places(config: Installation, every_m: float | None) -> tuple[float, ...] | None:
    """Return places every so many metres over the first nut's stroke, or over the screw.

    Returns:
        Places in m, rounded to 1 µm; None where `every_m` is None, for those of `[output]`.

    Raises:
        UserError: `every_m` exceeds the stretch, or would make more than 400 places.
    """
    if every_m is None:
        return None
    low_m, high_m = next((s.stroke_m for s in config.source if s.stroke_m), (0.0, config.screw.length_m))
    if not 0.0 < every_m <= high_m - low_m or (high_m - low_m) / every_m > MOST_PLACES:
        raise UserError(
            f"--every-m {every_m:g}: give between {(high_m - low_m) / MOST_PLACES:.2g} and "
            f"{high_m - low_m:g} m, the stretch that is reported"
        )
    count = int((high_m - low_m) / every_m + 1e-6)
    return tuple(round(low_m + i * every_m, 6) for i in range(count + 1))
