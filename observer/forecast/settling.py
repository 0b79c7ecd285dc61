"""Where the screw settles under a program, when it is there, and what a warm-up program would save."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import repeat
from typing import NamedTuple

import numpy as np

from observer.forecast.ahead import HOUR_S, Runner
from observer.forecast.program import Bins, Program
from observer.frames import BoolArray, EstimateBlock, FloatArray

STEP_S = 30.0
MOST_S = 24.0 * HOUR_S
_PART = 20
_STILL_K = 1e-3  # per part of ten minutes
_WORTH_S = 60.0
_DRAWS, _SEED, _Z95 = 12, 0, 1.96
_MORE = 1.02  # a program whose hardest part heats no more than this above its mean has no warm-up


@dataclass(frozen=True, slots=True)
class Settled:
    """Where the mean of the program leads, `field_degC`, `error_um` (g,), and after how long every point of
    the travel is there within the limit, None where it is not within a day or no error is known.

    `field_sigma_K`, `error_sigma_um` (g,) are the σ of where, None where it was not asked for.
    """

    field_degC: FloatArray
    error_um: FloatArray
    after_s: float | None
    field_sigma_K: FloatArray | None = None
    error_sigma_um: FloatArray | None = None


class WarmUp(NamedTuple):
    """For how long the hardest part of the program runs at once, and how much sooner it settles then."""

    lasts_s: float
    saves_s: float


def _steps(one: Bins, count: int = _PART) -> Bins:
    return one.at(np.zeros(count, np.int64))._replace(dt_s=np.full(count, STEP_S))


def _without_sigma(begin: Runner) -> Runner:
    """Only the means count here."""
    return replace(begin, state=replace(begin.state, P=np.zeros_like(begin.state.P)))


def settling(begin: Runner, program: Program, travel: BoolArray, within_um: float) -> Settled:
    """Follow the mean program until nothing changes; `travel` (g,) are the places of the grid that count."""
    parts = list[EstimateBlock]()
    for part in _without_sigma(begin).follow(repeat(_steps(program.mean))):
        parts.append(part)
        still = np.abs(part.field_degC[-1] - part.field_degC[0]).max() < _STILL_K
        if still or part.time_s[-1] >= MOST_S:
            break
    error_um = parts[-1].error_um[-1]
    return Settled(parts[-1].field_degC[-1], error_um, _there(parts, error_um, travel, within_um))


def _there(
    parts: Sequence[EstimateBlock], at_um: FloatArray, travel: BoolArray, within_um: float
) -> float | None:
    """The first moment from which on every point is within the limit; 0 where it always is."""
    if not at_um.size:
        return None
    time_s, path_um = (np.concatenate(c) for c in zip(*((p.time_s, p.error_um) for p in parts), strict=True))
    off = np.flatnonzero((np.abs(path_um - at_um)[:, travel] > within_um).any(axis=1))
    if not len(off):
        return 0.0
    return None if off[-1] + 1 >= len(time_s) else float(time_s[off[-1] + 1])


def draws(begin: Runner, program: Program, count: int = _DRAWS) -> list[Runner]:
    """What may be, by all that is not known now: each draw with another state, machine, and heats.

    Heats are off for good, by what the program varies in an hour too, and where they drift by a drift of an
    hour that dies away in one, as running-in does.
    """
    state, plant, n_x = begin.state, begin.plant, len(begin.plant.decay_1_s)
    free = np.flatnonzero(plant.estimated)
    own = slice(n_x, n_x + len(free))
    fading = replace(plant, heat_decay_1_s=np.full(len(free), 1.0 / HOUR_S)) if begin.drifts else plant
    mean_W = np.abs(program.mean.law_W[0] * begin.heats.ratio + begin.heats.extra_W)
    share = (mean_W / max(float(mean_W.sum()), 1e-12))[free]
    drift_W = np.sqrt(plant.random_walk_W2_s * HOUR_S)
    P = state.P.copy()
    varies = program.noise_W2_s / HOUR_S
    if begin.drifts:
        P[own, own] += varies * np.outer(share, share)
    values, axes = np.linalg.eigh(P)
    half = np.random.default_rng(_SEED).standard_normal((count // 2, len(P) + len(free)))
    found = []
    for draw in np.concatenate([half, -half]):
        x = state.x_hat + axes @ (np.sqrt(np.maximum(values, 0.0)) * draw[: len(P)])
        extra_W = begin.heats.extra_W.copy()
        if begin.drifts:
            extra_W[free] += x[own]
            x[own] = drift_W * draw[len(P) :]
        else:  # what heats have beside their laws is in the state, and dies away
            extra_W[free] += np.sqrt(varies) * share * draw[-1]
        found.append(begin.of(fading, x, begin.heats._replace(extra_W=extra_W)))
    return found


def with_spread(about: Settled, drawn: Sequence[Settled], weight: FloatArray) -> Settled:
    """Add the σ of where it settles, by draws and their weights (d,), which add up to 1."""
    field, error = (
        np.sqrt(weight @ (np.array([getattr(d, name) for d in drawn]) - getattr(about, name)) ** 2)
        for name in ("field_degC", "error_um")
    )
    return replace(about, field_sigma_K=field, error_sigma_um=error)


def settles_between_s(settled: Settled, drawn: Sequence[Settled]) -> tuple[float, float] | None:
    """The 95 % interval of when it has settled, None where that is not known: from how far its time is off in
    the draws of `draws`.
    """
    if settled.after_s is None:
        return None
    off_s = [(MOST_S if d.after_s is None else d.after_s) - settled.after_s for d in drawn]
    reach_s = _Z95 * float(np.sqrt(np.mean(np.square(off_s))))
    return max(settled.after_s - reach_s, 0.0), min(settled.after_s + reach_s, MOST_S)


def likely(
    sooner: WarmUp,
    program: Program,
    begins: Sequence[Runner],
    drawn: Sequence[Settled],
    travel: BoolArray,
    within_um: float,
) -> WarmUp | None:
    """A warm-up with what it saves in the median of the draws, None where that is nothing: a screw warmed for
    as long as a forecast says overshoots where the forecast is off.
    """
    saves_s = [
        (d.after_s or 0.0) - (_after_warm_up(b, program, sooner.lasts_s, d, travel, within_um) or MOST_S)
        for b, d in zip(begins, drawn, strict=True)
    ]
    found = sooner._replace(saves_s=float(np.median(saves_s)))
    return found if found.saves_s >= _WORTH_S else None


def _after_warm_up(
    begin: Runner,
    program: Program,
    lasts_s: float,
    settled: Settled,
    travel: BoolArray,
    within_um: float,
) -> float | None:
    """When it has settled after a warm-up, at the earliest at its end."""
    warm, _ = _without_sigma(begin).run(_steps(program.hardest, max(1, round(lasts_s / STEP_S))))
    most_s = lasts_s + 2.0 * (settled.after_s or MOST_S / 2.0)
    count = math.ceil((most_s - warm.after_s) / (_PART * STEP_S))
    parts = list(warm.follow(repeat(_steps(program.mean), count)))
    found = _there(parts, settled.error_um, travel, within_um)
    return None if found is None else max(found, lasts_s)


def warm_up(
    begin: Runner, program: Program, settled: Settled, travel: BoolArray, within_um: float
) -> WarmUp | None:
    """How much sooner it settles where the hardest part of the program runs at once until the mean heat
    content is that of the settled screw; None where that saves nothing.
    """
    hardest, mean = program.hardest, program.mean
    if not settled.after_s or hardest.total_W[0] <= _MORE * mean.total_W[0]:
        return None
    count, there_K = math.ceil(settled.after_s / (2.0 * STEP_S)), float(settled.field_degC.mean())
    parts = _without_sigma(begin).follow(repeat(_steps(hardest, 2), count))
    time_s = next((float(p.time_s[-1]) for p in parts if p.field_degC[-1].mean() >= there_K), None)
    if time_s is None:
        return None
    found = _after_warm_up(begin, program, time_s, settled, travel, within_um)
    if found is None or settled.after_s - found < _WORTH_S:
        return None
    return WarmUp(time_s, settled.after_s - found)


def when(
    begin: Runner, program: Program, travel: BoolArray, within_um: float
) -> tuple[Settled, tuple[float, float] | None, WarmUp | None]:
    """Where it settles and when, the 95 % interval of that, and the warm-up that is likely to help."""
    settled = settling(begin, program, travel, within_um)
    begins = draws(begin, program) if settled.after_s is not None else []
    drawn = [settling(b, program, travel, within_um) for b in begins]
    if drawn:
        settled = with_spread(settled, drawn, np.full(len(drawn), 1.0 / len(drawn)))
    sooner = warm_up(begin, program, settled, travel, within_um)
    if sooner is not None:
        sooner = likely(sooner, program, begins, drawn, travel, within_um)
    return settled, settles_between_s(settled, drawn), sooner
