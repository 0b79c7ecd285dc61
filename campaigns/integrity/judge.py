"""One machine with one fault: what was called good of it, and how much of that was wrong."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from campaigns.first_day.judge import runs
from campaigns.integrity.catalogue import HOUSINGS, NEW_PROGRAM, NONE
from campaigns.integrity.days import FAULT_S, FIRST_SEED, day_of
from campaigns.integrity.faults import Fault, Readings
from observer.frames import BoolArray, EstimateBlock, EstimateQuality, FloatArray, Quality
from tests.learning.cover import FROM_S, TWO_SIDED_95, estimates
from tests.learning.housings import HOUSED_CONFIG
from tests.learning.machines import CONFIG, Day, config_of
from tests.truth.machine.machine import SENSORS, stream

SIGMAS = 3.0
RIG, HOUSED_RIG = (
    text.replace("torque_Nm = 0.3", "torque_Nm = 0.3\nlead_m = 0.005") for text in (CONFIG, HOUSED_CONFIG)
)
"""The configuration as delivered, which knows the lead: a nut's way is held against speed times lead."""
NAMED_WITHIN_S = 60.0
"""Sensors that are named so soon after the first belong to the same answer."""
OUT = getattr(Quality, "EXCLUDED", Quality.REJECTED)
BOUNDS = {"heat": "heat_bound_W", "field": "field_bound_K", "error": "error_bound_um"}


class Verdict(NamedTuple):
    """Of the steps from the fault on (from ten minutes on without one).

    `steps`, `good`: how many, and how many of them were good; of the good ones `wrong`, with any value beyond
    3 σ, `heats`, `field` and `error` alike, and `beyond`, with any beyond its bound, in so many
    `excursions`, runs of consecutive steps (None: no bounds).
    `sigmas`, `worst_um`: the farthest of a good one, in σ and of the error. `bad_s`, `again_s`: the first
    step that was not good, and the first after it that was. `named_s`, `named`: when a sensor was first taken
    out and which were within a minute; `right`: "yes", "part", "no" or "". `out`: how often one was taken
    out. `half_um`, `bound_um`: means of the 95 % half width and of the bound of the error at the far end.
    """

    steps: int
    good: int
    wrong: int
    heats: int
    field: int
    error: int
    beyond: int | None
    excursions: int | None
    sigmas: float
    worst_um: float
    bad_s: float | None
    again_s: float | None
    named_s: float | None
    named: str
    right: str
    out: int
    half_um: float
    bound_um: float | None


def faulty(day: Day, fault: Fault, number: int) -> Day:
    """The day as it is logged with a fault from `FAULT_S` on."""
    late = day.time_s >= FAULT_S
    before = Readings(day.time_s[late] - FAULT_S, day.sensor_degC[late], day.nut_m[late], day.air_degC[late])
    after = fault.change(before, stream(FIRST_SEED, fault.name, str(number)))
    changed = {name: getattr(day, name).copy() for name in ("sensor_degC", "nut_m", "air_degC")}
    for name, column in changed.items():
        column[late] = getattr(after, name)
    return day._replace(**changed)


def judged(fault: Fault, number: int, more: str = "") -> Verdict:
    """Run one machine with one fault; `more` is added to the configuration."""
    housed = fault.group == HOUSINGS
    day = day_of(number, new_stroke=fault.name == NEW_PROGRAM, housed=housed)
    block = estimates(config_of(HOUSED_RIG if housed else RIG, more), faulty(day, fault, number))
    return verdict(block, day, fault)


def verdict(block: EstimateBlock, day: Day, fault: Fault) -> Verdict:
    """Hold estimates against the truth."""
    watched = day.time_s - day.time_s[0] >= (FROM_S if fault.name == NONE else FAULT_S)
    good = watched & (block.quality == EstimateQuality.GOOD)
    off = {
        "heat": (block.heat_W - day.heat_W, block.heat_sigma_W),
        "field": (block.field_degC - day.field_degC, block.field_sigma_K),
        "error": ((block.error_um - day.error_um)[:, 1:], block.error_sigma_um[:, 1:]),
    }
    ratio = {name: np.max(np.abs(error) / sigma, axis=1) for name, (error, sigma) in off.items()}
    worst = np.max(list(ratio.values()), axis=0)
    bounds = {name: _bound(block, column) for name, column in BOUNDS.items()}
    far = bounds["error"]
    beyond = _beyond(off, bounds, good)
    bad_s, again_s = _times(block, day.time_s, watched)
    named_s, named, right = _named(block, day.time_s, fault)
    return Verdict(
        steps=int(watched.sum()),
        good=int(good.sum()),
        wrong=_over(worst[good]),
        heats=_over(ratio["heat"][good]),
        field=_over(ratio["field"][good]),
        error=_over(ratio["error"][good]),
        beyond=None if beyond is None else int(beyond.sum()),
        excursions=None if beyond is None else runs(beyond),
        sigmas=float(worst[good].max(initial=0.0)),
        worst_um=float(np.abs(off["error"][0])[good].max(initial=0.0)),
        bad_s=bad_s,
        again_s=again_s,
        named_s=named_s,
        named=named,
        right=right,
        out=int(_taken_out(block)[watched].sum()),
        half_um=_mean(TWO_SIDED_95 * block.error_sigma_um[good, -1]),
        bound_um=None if far is None else _mean(far[good, -1]),
    )


def _over(sigmas: FloatArray) -> int:
    """How many are beyond 3 σ, or no number at all."""
    return int((~(sigmas <= SIGMAS)).sum())


def _bound(block: EstimateBlock, column: str) -> FloatArray | None:
    value = getattr(block, column, None)
    return None if value is None or value.size == 0 else value


def _beyond(
    off: dict[str, tuple[FloatArray, FloatArray]], bounds: dict[str, FloatArray | None], good: BoolArray
) -> BoolArray | None:
    """Return which good steps have a value beyond its bound (K,)."""
    found = [
        ~np.all(np.abs(error) <= bound[:, -error.shape[1] :], axis=1)
        for name, (error, _) in off.items()
        if (bound := bounds[name]) is not None
    ]
    return np.asarray(np.any(found, axis=0) & good) if found else None


def _mean(value: FloatArray) -> float:
    return float(np.mean(value)) if value.size else float("nan")


def _first_s(time_s: FloatArray, which: BoolArray) -> float | None:
    found = np.flatnonzero(which)
    return float(time_s[found[0]] - FAULT_S) if len(found) else None


def _times(block: EstimateBlock, time_s: FloatArray, watched: BoolArray) -> tuple[float | None, float | None]:
    """When the estimate was not good for the first time from the fault on, and when it was good again."""
    late = watched & (time_s >= FAULT_S)
    good = block.quality == EstimateQuality.GOOD
    bad_s = _first_s(time_s, late & ~good)
    again = None if bad_s is None else _first_s(time_s, (time_s >= FAULT_S + bad_s) & good)
    return bad_s, again


def _taken_out(block: EstimateBlock) -> BoolArray:
    """(K, s): at which steps a sensor is taken out that was not before."""
    out = block.sensor_quality == OUT
    return np.asarray(out & ~np.vstack([np.zeros((1, out.shape[1]), bool), out[:-1]]))


def _named(block: EstimateBlock, time_s: FloatArray, fault: Fault) -> tuple[float | None, str, str]:
    """Which sensors were taken out first from the fault on, and whether they are those at fault."""
    late: BoolArray = _taken_out(block)
    late[time_s < FAULT_S] = False
    first_s = _first_s(time_s, np.any(late, axis=1))
    if first_s is None:
        return None, "", "no" if fault.sensors else ""
    near = late[time_s <= FAULT_S + first_s + NAMED_WITHIN_S]
    named = {name for name, out in zip(SENSORS, np.any(near, axis=0), strict=False) if out}
    right = "yes" if named == set(fault.sensors) else "part" if named < set(fault.sensors) else "no"
    return first_s, " ".join(sorted(named)), right
