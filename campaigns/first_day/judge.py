"""One machine's shift through the product: what was called good of its thermal error, and was it right?"""

from __future__ import annotations

import tempfile
import time
from dataclasses import fields
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
GOOD = EstimateQuality.GOOD.label


class Verdict(NamedTuple):
    """What one shift shows, a row a second.

    `first_good_s`: when the error was first good; `good_at_once`: the very first estimate was. Of the `steps`
    from then on `good` were good, `beyond_3_sigma` of them with the error of any place beyond 3 σ, and
    `grown_beyond_3_sigma` with the growth since the start beyond it. At the end of travel farthest from the
    fixed bearing, over good steps: `sigmas_um` and `squares_um2`, sums of σ and of the squared error, and the
    largest error `worst_um`. `bounded`: good steps with a published bound, there `bounds_um` and
    `bounded_half_um`, sums of the bound and of 1.96 σ; `beyond_bound`: steps with an error beyond it at any
    place, in `excursions` runs. `jumps`, `exclusions`: of the nut's position, of sensors, though nothing was
    wrong. `armed_s`: when the compensation could be armed; `released`: how often it then let go.
    `replay_s`: what the replay took.
    """

    hours: float
    first_good_s: float | None
    good_at_once: int
    steps: int
    good: int
    beyond_3_sigma: int
    grown_beyond_3_sigma: int
    sigmas_um: float
    squares_um2: float
    worst_um: float
    last_um: float
    rms_um: float
    bounded: int
    bounds_um: float
    bounded_half_um: float
    beyond_bound: int
    excursions: int
    jumps: int
    exclusions: int
    armed_s: float | None
    not_armed: int
    released: int
    reason: str
    replay_s: float


def row_of(number: int, hours: float, folder: Path) -> list[dict[str, str]]:
    """Judge a machine; return its row."""
    verdict = judged(number, hours, folder / f"machine-{number}")
    cells = ("" if v is None else f"{v:.6g}" if isinstance(v, float) else str(v) for v in verdict)
    return [dict(zip(("machine", *Verdict._fields), (str(number), *cells), strict=True))]


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


def verdict(
    machine: FirstDayMachine, shift: Shift, estimates: Estimates, config: Installation, replay_s: float
) -> Verdict:
    """Hold a shift's estimates against its truth."""
    places_m = positions_m(machine)
    looked = slice(0, None, TRUTH_EVERY)
    mean_um, sigma_um, bound_um = (
        along(estimates, "error", unit)[looked] for unit in ("um", "sigma_um", "bound_um")
    )
    zero_degC = float(np.round(shift.readings[0, -1], 1))
    true_um = error_um(machine, shift.screw_degC, places_m, zero_degC)
    grown_um = error_um(machine, shift.screw_degC, places_m, shift.screw_degC[0])
    called_good = error_quality(estimates) == GOOD
    good = called_good[looked]
    begins = np.flatnonzero(called_good)
    first = int(np.argmax(good)) if good.any() else len(good)
    moves = machine.known.fixed == "left"
    held = 0 if moves else -1
    off_um = np.delete(mean_um - true_um, held, axis=1)
    far = int(np.argmin(np.abs(places_m - machine.known.stroke_m[1 if moves else 0])))
    far_um = (mean_um - true_um)[:, far]
    beyond = np.any(np.abs(off_um) > 3.0 * np.delete(sigma_um, held, axis=1), axis=1)
    grown = np.any(
        np.abs(np.delete(mean_um - grown_um, held, axis=1)) > 3.0 * np.delete(sigma_um, held, axis=1), axis=1
    )
    bounded = good & np.isfinite(bound_um[:, far])
    outside = bounded & np.any(np.abs(off_um) > np.delete(bound_um, held, axis=1), axis=1)
    armed_s, released, reason = arming(config, shift.time_s[looked], estimates, places_m)
    return Verdict(
        hours=float(shift.time_s[-1]) / 3600.0,
        first_good_s=float(shift.time_s[begins[0]]) if len(begins) else None,
        good_at_once=int(called_good[0]),
        steps=max(len(good) - first, 1),
        good=int(good.sum()),
        beyond_3_sigma=int((beyond & good).sum()),
        grown_beyond_3_sigma=int((grown & good).sum()),
        sigmas_um=float(sigma_um[good, far].sum()),
        squares_um2=float((far_um[good] ** 2).sum()),
        worst_um=float(np.abs(far_um[good]).max(initial=0.0)),
        last_um=float(true_um[-1, far]),
        rms_um=float(np.sqrt(np.mean(far_um**2))),
        bounded=int(bounded.sum()),
        bounds_um=float(bound_um[bounded, far].sum()),
        bounded_half_um=float(TWO_SIDED_95 * sigma_um[bounded, far].sum()),
        beyond_bound=int(outside.sum()),
        excursions=runs(outside),
        jumps=sum("nut_position_m has jumped" in text for text in estimates.summary["reasons"]),
        exclusions=sum(runs(np.asarray(estimates[f"quality_{name}"]) == "excluded") for name in SENSORS),
        armed_s=armed_s,
        not_armed=int(armed_s is None),
        released=released,
        reason=reason,
        replay_s=replay_s,
    )


def along(estimates: Estimates, quantity: str, unit: str) -> FloatArray:
    """Return a quantity at all places of the screw, (K, g), from the columns of `estimates.csv`."""
    places = [
        name for name in estimates.signals if name.startswith(f"{quantity}_") and name.endswith(f"_{unit}")
    ]
    own = [name for name in places if name.count("_") == 1 + len(unit.split("_"))]
    return np.column_stack([np.asarray(estimates[name], dtype=float) for name in own])


def error_quality(estimates: Estimates) -> Any:
    """Return the quality of the thermal error in words, (K,): its own where there is one."""
    own = "error_quality" if "error_quality" in estimates.signals else "quality"
    return np.asarray(estimates[own])


def runs(flags: BoolArray) -> int:
    """Return in how many runs of consecutive steps a condition holds."""
    return int(flags[0]) + int((flags[1:] & ~flags[:-1]).sum())


def arming(
    config: Installation, time_s: FloatArray, estimates: Estimates, places_m: FloatArray
) -> tuple[float | None, int, str]:
    """Return when the compensation could first be armed, by somebody who asks each second, how often it then
    let go of its own, and the last reason for either; what it does is the product's own.
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
    known = {
        "time_s": np.array([time_s]),
        "error_um": error[None],
        "error_sigma_um": sigma[None],
        "error_bound_um": bound[None],
    }
    qualities = {f.name: np.array([quality]) for f in fields(EstimateBlock) if f.name.endswith("quality")}
    empty = {f.name: np.zeros((1, 0)) for f in fields(EstimateBlock)}
    return EstimateBlock(**(empty | qualities | {"sensor_quality": np.zeros((1, 0), int)} | known))
