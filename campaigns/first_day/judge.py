"""One machine's shift through the product: when its thermal error is called good, and whether it is."""

from __future__ import annotations

import tempfile
import time
from dataclasses import MISSING, fields
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

import observer
from campaigns.first_day.configuration import positions_m, write_configuration
from observer import Estimates, Machine
from observer.control import compensation
from observer.frames import BoolArray, EstimateBlock, EstimateQuality, FloatArray
from observer.installation import Installation, load
from tests.truth.first_day.log import SENSORS, TRUTH_EVERY, Shift, shift_of, write_shift
from tests.truth.first_day.machine import FirstDayMachine, draw_machine
from tests.truth.first_day.thermal import error_um

TWO_SIDED_95 = 1.96
POSITION = "nut_position_m"
"""The nut's position is right and comes in time, so every reason that names its channel is a false jump."""
GOOD = EstimateQuality.GOOD.label


class Verdict(NamedTuple):
    """The figures of one shift, counted each second.

    The error is taken at every reported place; sums and means in µm at the end of travel farthest from the
    fixed bearing. Nothing is wrong with these machines, so every jump and exclusion is false.
    """

    hours: float
    first_good_s: float | None  # when the error was first good
    good_at_once: int  # 1 where the very first estimate was
    steps: int  # from the first good one on
    good: int  # of these
    beyond_3_sigma: int  # good steps with the error of any place beyond 3 σ
    grown_beyond_3_sigma: int  # the same, where growth since the start is taken for the truth
    sigmas_um: float  # sum of σ over good steps
    squares_um2: float  # sum of the squared error over good steps
    worst_um: float  # largest error of a good step
    rms_um: float  # rms error of all steps
    last_um: float  # the true thermal error at the end
    bounded: int  # good steps with a published bound
    bounds_um: float  # sum of the bound over these
    bounded_half_um: float  # sum of 1.96 σ over these
    beyond_bound: int  # of these, with the error of any place beyond its bound
    excursions: int  # runs of such steps
    jumps: int  # reasons that name the nut's position
    exclusions: int  # how often a sensor was excluded
    armed_s: float | None  # when the compensation could first be armed
    not_armed: int  # 1 where it never could
    released: int  # how often it switched itself off
    reason: str  # the last reason why it was off
    not_good: str  # the reason that kept most steps from being good
    replay_s: float  # duration of the replay


def row_of(shift: tuple[int, float], folder: Path | None = None) -> list[dict[str, str]]:
    """Judge a machine's shift of so many hours; return its row. Its files stay in the folder, if any."""
    number, hours = shift
    files = None if folder is None else folder / f"machine-{number}"
    verdict = judged(number, hours, files)
    cells = ("" if v is None else f"{v:.6g}" if isinstance(v, float) else str(v) for v in verdict)
    return [
        dict(zip(("machine", "shift_h", *Verdict._fields), (str(number), f"{hours:g}", *cells), strict=True))
    ]


def write_machine(folder: Path, number: int, hours: float) -> tuple[FirstDayMachine, Shift]:
    """Write `config.toml`, `log.csv.gz` and `truth.csv.gz` of a machine's shift; return both."""
    machine = draw_machine(number)
    shift = shift_of(machine, hours)
    folder.mkdir(parents=True, exist_ok=True)
    write_shift(folder, machine, shift, positions_m(machine))
    write_configuration(folder / "config.toml", machine)
    return machine, shift


def judged(number: int, hours: float, folder: Path | None = None) -> Verdict:
    """Simulate a machine's shift, replay it as configured, and hold the estimates against the truth."""
    if folder is None:
        with tempfile.TemporaryDirectory() as scratch:
            return judged(number, hours, Path(scratch))
    machine, shift = write_machine(folder, number, hours)
    product: Machine = observer.load(folder / "config.toml")
    begun = time.perf_counter()
    estimates = product.replay(folder / "log.csv.gz")
    replay_s = time.perf_counter() - begun
    return verdict(machine, shift, estimates, load(folder / "config.toml"), replay_s)


class ErrorSeries(NamedTuple):
    """The thermal error each second at the places that can move, (k, g)."""

    off_um: FloatArray  # estimate less truth
    off_grown_um: FloatArray  # estimate less growth since the start
    sigma_um: FloatArray
    bound_um: FloatArray
    far: int  # the column at the end of travel farthest from the fixed bearing
    true_um: FloatArray  # (k,) the truth there


def error_series(machine: FirstDayMachine, shift: Shift, estimates: Estimates) -> ErrorSeries:
    """Return the estimated thermal error beside the truth, which is 0 at the first logged air temperature."""
    left = machine.nameplate.fixed == "left"
    moves = slice(1, None) if left else slice(None, -1)
    places_m = positions_m(machine)[moves]
    far = int(np.argmin(np.abs(places_m - machine.nameplate.stroke_m[1 if left else 0])))
    mean_um, sigma_um, bound_um = (
        along(estimates, "error", unit)[::TRUTH_EVERY, moves] for unit in ("um", "sigma_um", "bound_um")
    )
    zero_degC = float(np.round(shift.readings[0, -1], 1))
    true_um, grown_um = (
        error_um(machine, shift.screw_degC, places_m, zero) for zero in (zero_degC, shift.screw_degC[0])
    )
    return ErrorSeries(mean_um - true_um, mean_um - grown_um, sigma_um, bound_um, far, true_um[:, far])


def verdict(
    machine: FirstDayMachine, shift: Shift, estimates: Estimates, config: Installation, replay_s: float
) -> Verdict:
    """Hold a shift's estimates against its truth."""
    series = error_series(machine, shift, estimates)
    called_good = error_quality(estimates) == GOOD
    begins = np.flatnonzero(called_good)
    good = called_good[::TRUTH_EVERY]
    first = int(np.argmax(good)) if good.any() else len(good) - 1
    far_um, far_sigma_um = series.off_um[:, series.far], series.sigma_um[:, series.far]
    far_bound_um = series.bound_um[:, series.far]
    limit_um = 3.0 * series.sigma_um
    reasons: dict[str, int] = estimates.summary["reasons"]
    bounded = good & np.isfinite(far_bound_um)
    outside = bounded & np.any(np.abs(series.off_um) > series.bound_um, axis=1)
    armed_s, released, reason = arming(config, shift.true_time_s, estimates, positions_m(machine))
    return Verdict(
        hours=float(shift.time_s[-1]) / 3600.0,
        first_good_s=float(shift.time_s[begins[0]]) if len(begins) else None,
        good_at_once=int(called_good[0]),
        steps=len(good) - first,
        good=int(good.sum()),
        beyond_3_sigma=int((good & ~np.all(np.abs(series.off_um) <= limit_um, axis=1)).sum()),
        grown_beyond_3_sigma=int((good & ~np.all(np.abs(series.off_grown_um) <= limit_um, axis=1)).sum()),
        sigmas_um=float(far_sigma_um[good].sum()),
        squares_um2=float((far_um[good] ** 2).sum()),
        worst_um=float(np.abs(far_um[good]).max(initial=0.0)),
        rms_um=float(np.sqrt(np.mean(far_um**2))),
        last_um=float(series.true_um[-1]),
        bounded=int(bounded.sum()),
        bounds_um=float(far_bound_um[bounded].sum()),
        bounded_half_um=float(TWO_SIDED_95 * far_sigma_um[bounded].sum()),
        beyond_bound=int(outside.sum()),
        excursions=runs(outside),
        jumps=sum(POSITION in reason for reason in reasons),
        exclusions=sum(runs(np.asarray(estimates[f"quality_{name}"]) == "excluded") for name in SENSORS),
        armed_s=armed_s,
        not_armed=int(armed_s is None),
        released=released,
        reason=reason,
        not_good=max(reasons, key=lambda text: reasons[text], default=""),
        replay_s=replay_s,
    )


def along(estimates: Estimates, quantity: str, unit: str) -> FloatArray:
    """Return a quantity at all places of the screw, (K, g), from the columns of `estimates.csv`."""
    places = [
        name for name in estimates.signals if name.startswith(f"{quantity}_") and name.endswith(f"_{unit}")
    ]
    columns = [name for name in places if name.count("_") == 1 + len(unit.split("_"))]
    return np.column_stack([np.asarray(estimates[name], dtype=float) for name in columns])


def error_quality(estimates: Estimates) -> Any:
    """Return the quality of the thermal error in words, (K,): its own where there is one."""
    column = "error_quality" if "error_quality" in estimates.signals else "quality"
    return np.asarray(estimates[column])


def runs(flags: BoolArray) -> int:
    """Return in how many runs of consecutive steps a condition holds."""
    return int(flags[0]) + int((flags[1:] & ~flags[:-1]).sum())


def arming(
    config: Installation, time_s: FloatArray, estimates: Estimates, places_m: FloatArray
) -> tuple[float | None, int, str]:
    """Return when the compensation could first be armed, how often it then switched itself off, and the last
    reason. Somebody tries to arm it each second while it is off.
    """
    plan = compensation.plan_of(config)
    state = compensation.initial(plan)
    columns = {
        unit: along(estimates, "error", unit)[::TRUTH_EVERY] for unit in ("um", "sigma_um", "bound_um")
    }
    labels = {quality.label: int(quality) for quality in EstimateQuality}
    quality = np.array([labels[word] for word in error_quality(estimates)[::TRUTH_EVERY]])
    armed_s, released, reason = None, 0, ""
    for k, now_s in enumerate(time_s):
        was_armed = state.armed
        block = _block(now_s, quality[k], *(columns[unit][k] for unit in columns))
        state = compensation.advance(plan, state, block, places_m, arm=not was_armed)
        released += was_armed and not state.armed
        reason = state.reason or reason
        if state.armed and armed_s is None:
            armed_s = float(now_s)
    return armed_s, released, reason


def _block(
    time_s: float, quality: int, error: FloatArray, sigma: FloatArray, bound: FloatArray
) -> EstimateBlock:
    """Return a block of one estimate that holds nothing but its thermal error."""
    columns = {
        "time_s": np.array([time_s]),
        "quality": np.array([quality]),
        "sensor_quality": np.zeros((1, 0), int),
        "error_um": error[None],
        "error_sigma_um": sigma[None],
        "error_bound_um": bound[None],
    }
    required = (field.name for field in fields(EstimateBlock) if field.default_factory is MISSING)
    return EstimateBlock(**({name: np.zeros((1, 0)) for name in required} | columns))
