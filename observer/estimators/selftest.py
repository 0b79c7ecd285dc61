"""A self-test that always runs: do sensors and model agree, and does each heat lie near its law?

Innovations of a filter whose model is right are white, of mean nothing and of the size it expects (Kailath
1968; Mehra and Peschon 1971). They are averaged over about a minute and about ten, per sensor. A wrong model
or a wrong input need not show there, because the heats make up for it: so each heat is held against its law
within what the law is trusted for, and all heats together, since a wrong film or ambient moves all of them
one way. What fails lowers the quality of the estimate, and says why; it clears when the last minute is clean.
"""

# mypy: disable-error-code="no-untyped-def, misc"

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, replace
from enum import IntEnum
from typing import NamedTuple

import numpy as np

from observer.compiled import cached_call, inlined
from observer.estimators.compiled.judging import (
    ESTIMATE_DEGRADED,
    ESTIMATE_INVALID,
    ESTIMATE_STARTING,
    GOOD,
    NUT_LOST,
    REJECTED,
)
from observer.frames import EstimateBlock, FloatArray, FrameBlock, Inputs, QualityArray
from observer.model.plant import Plant

# The windows' time constants, and which means over each are more than chance and small faults make.
WINDOWS_S = np.array([60.0, 600.0])
_SURE = 6.0  # standard errors
_BIAS = np.array([0.4, 0.25])  # of σ
_COLOUR = np.array([0.35, 0.25])  # lag-one correlation
_NOISE = 1.5  # of σ², beyond the one that is expected
_LAW_WINDOWS_S = np.array([15.0, 600.0])
_OFF_LAW = np.array([3.0, 2.5])  # of what law and estimate are trusted for …
_ALL_OFF_LAW = np.array([2.5, 2.0])  # … and of all of them together
_CLEAR = 0.7  # part of a limit below which a reason is gone …
_CLEAN = 0.3  # … or of the last minute's, whatever there was before
_CLIP = 5.0
_CLIP_LAW = 30.0
_KNOWN = 0.6  # part of its prior below which the σ of a heat must be for the heat to be known
_PEAK_S = 3600.0  # for how long the largest heat by a law counts for what the law is trusted for …
_FLOOR = 0.05  # … by this part of it
_LEAST_W = 0.3
_MOTION_S = 20.0
_MOTION_ENOUGH = 1.0  # strokes


DISAGREE = 1.5
"""Ratio of the way a nut makes to what speed and lead allow, beyond which the two disagree …"""
FALLS_SHORT = 0.5
"""… and below which they do; samples cut reversals off, so a way may well fall short."""


class Fault(IntEnum):
    """What may fail, of a sensor (the first four), a heat (two), all heats, or a nut."""

    BIASED = 0
    COLOURED = 1
    NOISY = 2
    REFUSED = 3
    UNKNOWN = 4
    OFF_LAW = 5
    ALL_OFF_LAW = 6
    MOTION = 7


_OF_SENSOR, _OF_HEAT = 4, 2


@dataclass(frozen=True, slots=True)
class Finding:
    """One thing that fails: what, of which sensor, source or nut, since when, and by how much.

    `value` is in the unit of the fault: a mean in σ, a correlation, a ratio to the expected noise, the
    innovation in K, a heat in W, a ratio of ways; `expected` what it is held against.
    """

    fault: Fault
    subject: str
    since_s: float
    value: float
    expected: float


class SelfTestState(NamedTuple):
    """What is remembered, changed in place by the kernel on a copy.

    `sensor` (s, 2, 4): per window the means of the normalised innovation, of its product with the one before
    and of its square, and the variance factor of such a mean; `last` (s, 2) the innovation before and its
    time; `heat` (m_e + 1, 2) the mean distance from the law per window, the last row that of all heats;
    `peak_W` (m_e,); `motion` (M, 5) way made, way allowed, and the last sample; `since_s`, `value`,
    `expected` (T,) of each test, NaN while it passes; `steps`, `first_s` (T,) how often it has failed, and
    when first; `refused` (1,) whether a sensor was refused at the last step.
    """

    sensor: FloatArray
    last: FloatArray
    heat: FloatArray
    peak_W: FloatArray
    motion: FloatArray
    since_s: FloatArray
    value: FloatArray
    expected: FloatArray
    steps: FloatArray
    first_s: FloatArray
    refused: FloatArray


class Trust(NamedTuple):
    """What heats are held against, (m_e,): σ at the start, and what laws are trusted for (NaN: no law)."""

    initial_W: FloatArray
    law_uncertainty: FloatArray


class _Seen(NamedTuple):
    """K steps as the kernel takes them; names and shapes as in `Inputs` and `EstimateBlock`."""

    time_s: FloatArray
    dt_s: FloatArray
    given: QualityArray
    sensor_quality: QualityArray
    nu: FloatArray
    nu_sigma: FloatArray
    heat_W: FloatArray
    heat_sigma_W: FloatArray
    law_W: FloatArray
    motion: FloatArray


class SelfTest:
    """The self-test of one plant; holds no state of its own."""

    def __init__(self, plant: Plant, with_law: Collection[str]) -> None:
        """Fix what is tested; `with_law` are the sources that have a law."""
        has_law = np.array([name in with_law for name in plant.layout.sources], dtype=np.bool_)
        self._trust = Trust(
            np.ascontiguousarray(plant.initial_sigma_W, dtype=float),
            np.where(has_law, plant.law_uncertainty, np.nan),
        )
        self._sensors, self._sources = plant.layout.sensors, plant.layout.sources
        self._nuts = {s.channel: s.table.stroke_m for s in plant.moving}

    def initial(self) -> SelfTestState:
        """Return the state before the first step."""
        s, m_e, M = len(self._sensors), len(self._sources), len(self._nuts)
        tests = _OF_SENSOR * s + _OF_HEAT * m_e + 1 + M
        return SelfTestState(
            sensor=np.zeros((s, 2, 4)),
            last=np.full((s, 2), np.nan),
            heat=np.zeros((m_e + 1, 2)),
            peak_W=np.zeros(m_e),
            motion=np.hstack([np.zeros((M, 2)), np.full((M, 3), np.nan)]),
            since_s=np.full(tests, np.nan),
            value=np.full(tests, np.nan),
            expected=np.full(tests, np.nan),
            steps=np.zeros(tests),
            first_s=np.full(tests, np.nan),
            refused=np.zeros(1),
        )

    def watch(
        self, state: SelfTestState, frames: FrameBlock, inputs: Inputs
    ) -> tuple[SelfTestState, FloatArray, Inputs]:
        """Compare each nut's way with its speed, before the estimator runs.

        Return the state, the ratios (K, M), and the inputs, degraded where the two disagree.
        """
        state = SelfTestState._make(array.copy() for array in state)
        motion, degraded = np.empty((len(inputs), len(self._nuts))), inputs.degraded.copy()
        for i, (channel, stroke_m) in enumerate(self._nuts.items()):
            _compare_ways(*frames.path[channel], stroke_m, state.motion[i], motion[:, i], degraded)
        return state, motion, inputs._replace(degraded=degraded)

    def run(
        self, state: SelfTestState, motion: FloatArray, inputs: Inputs, block: EstimateBlock
    ) -> tuple[SelfTestState, EstimateBlock]:
        """Return the state after K steps, and the estimates with the qualities that they have earned.

        `state` and `motion` are those that `watch` returned.
        """
        quality = block.quality.copy()
        seen = _Seen(
            block.time_s, inputs.dt_s, inputs.quality, block.sensor_quality, block.innovation_K,
            block.innovation_sigma_K, block.heat_W, block.heat_sigma_W, block.law_W, motion,
        )  # fmt: skip
        _test(seen, self._trust, state, quality)
        return state, replace(block, quality=quality)

    def findings(self, state: SelfTestState) -> tuple[Finding, ...]:
        """What fails now."""
        return tuple(
            self._finding(state, test, state.since_s)
            for test in np.flatnonzero(np.isfinite(state.since_s)).tolist()
        )

    def history(self, state: SelfTestState) -> tuple[tuple[Finding, int], ...]:
        """What has ever failed, since it did first and as it was last, and in how many steps."""
        return tuple(
            (self._finding(state, test, state.first_s), int(state.steps[test]))
            for test in np.flatnonzero(state.steps).tolist()
        )

    def _finding(self, state: SelfTestState, test: int, since_s: FloatArray) -> Finding:
        fault, subject = self._meaning(test)
        return Finding(
            fault, subject, float(since_s[test]), float(state.value[test]), float(state.expected[test])
        )

    def _meaning(self, test: int) -> tuple[Fault, str]:
        s, m_e = len(self._sensors), len(self._sources)
        if test < _OF_SENSOR * s:
            return Fault(test % _OF_SENSOR), self._sensors[test // _OF_SENSOR]
        test -= _OF_SENSOR * s
        if test < _OF_HEAT * m_e:
            return Fault(_OF_SENSOR + test % _OF_HEAT), self._sources[test // _OF_HEAT]
        test -= _OF_HEAT * m_e
        return (Fault.ALL_OFF_LAW, "") if test == 0 else (Fault.MOTION, list(self._nuts)[test - 1])


@cached_call
def _compare_ways(sample_s, sample_m, offset, driven_m_s, stroke_m, memory, ratio, degraded):
    """After each of K steps the way a nut made lately over what speed and lead allow; NaN if too little.

    Where the two disagree, the place of the nut is not known.
    """
    for k in range(len(ratio)):
        for i in range(offset[k], offset[k + 1]):
            since_s = sample_s[i] - memory[2]
            allowed_m = 0.5 * (driven_m_s[i] + memory[4]) * since_s
            if 0.0 < since_s < 10.0 and 2.5 * allowed_m <= stroke_m:
                fade = np.exp(-since_s / _MOTION_S)
                memory[0] = fade * memory[0] + abs(sample_m[i] - memory[3])
                memory[1] = fade * memory[1] + allowed_m
            memory[2], memory[3], memory[4] = sample_s[i], sample_m[i], driven_m_s[i]
        ratio[k] = np.nan
        if max(memory[0], memory[1]) >= _MOTION_ENOUGH * stroke_m:
            ratio[k] = memory[0] / max(memory[1], 1e-6 * stroke_m)
        if ratio[k] > DISAGREE or ratio[k] < FALLS_SHORT:
            degraded[k] = NUT_LOST


@inlined
def _note(state, test, score, time_s, value, expected):
    """Note how a test stands, by its score: 1 and more fails, and below `_CLEAR` passes again."""
    failing = not np.isnan(state.since_s[test])
    if score >= 1.0 or (failing and score >= _CLEAR):
        if not failing:
            state.since_s[test] = time_s
        if state.steps[test] == 0.0:
            state.first_s[test] = time_s
        state.steps[test] += 1.0
        state.value[test], state.expected[test] = value, expected
    else:
        state.since_s[test] = np.nan


@inlined
def _average(state, i, nu, time_s):
    """Take a normalised innovation of sensor i into its means."""
    before, since_s = state.last[i, 0], time_s - state.last[i, 1]
    state.last[i, 0], state.last[i, 1] = nu, time_s
    if not since_s > 0.0:
        return
    for w in range(len(WINDOWS_S)):
        share = 1.0 - np.exp(-since_s / WINDOWS_S[w])
        own = state.sensor[i, w]
        own[0] += share * (nu - own[0])
        own[1] += share * (nu * before - own[1])
        own[2] += share * (nu * nu - own[2])
        own[3] = (1.0 - share) ** 2 * own[3] + share * share


@inlined
def _scores(state, i, scores):
    """The scores of sensor i: bias, colour, noise; a clean minute makes the longer window forget."""
    scores[:] = 0.0
    for w in range(len(WINDOWS_S)):
        own = state.sensor[i, w]
        sure = 1.0 / (_SURE * np.sqrt(max(own[3], 1e-300)))
        scores[0] = max(scores[0], min(abs(own[0]) * sure, abs(own[0]) / _BIAS[w]))
        scores[1] = max(scores[1], min(own[1] * sure, own[1] / _COLOUR[w]))
        scores[2] = max(scores[2], min((own[2] - 1.0) * sure / np.sqrt(2.0), (own[2] - 1.0) / _NOISE))
    last, long = state.sensor[i, 0], state.sensor[i, 1]
    clean = abs(last[0]) < _CLEAN * _BIAS[0] and last[1] < _CLEAN * _COLOUR[0]
    if clean and last[2] < 1.0 + _CLEAN * _NOISE and max(scores[0], scores[1], scores[2]) >= 1.0:
        for q in range(3):
            long[q] = last[q]


@inlined
def _off_law(state, row, distance, dt_s, limit):
    """Take in how far a heat is from its law; return the score."""
    score = 0.0
    clipped = min(max(distance, -_CLIP_LAW), _CLIP_LAW)
    for w in range(len(WINDOWS_S)):
        state.heat[row, w] += (1.0 - np.exp(-dt_s / _LAW_WINDOWS_S[w])) * (clipped - state.heat[row, w])
        score = max(score, abs(state.heat[row, w]) / limit[w])
    if score >= 1.0 and abs(state.heat[row, 0]) < _CLEAN * limit[0]:
        state.heat[row, 1] = state.heat[row, 0]
    return score


@inlined
def _fails(state, test):
    """Whether a test fails now."""
    return not np.isnan(state.since_s[test])


@inlined
def _is_refused(u, k, i):
    """Whether sensor i was good when it came, and refused by the gate."""
    return u.given[k, i] == GOOD and u.sensor_quality[k, i] == REJECTED


@inlined
def _forget_after_refusals(state, u, k):
    """Begin the means afresh when no sensor is refused any more: the state has been another one since."""
    refused = 0.0
    for i in range(u.nu.shape[1]):
        if _is_refused(u, k, i):
            refused = 1.0
    if refused == 0.0 and state.refused[0] > 0.0:
        state.sensor[:] = 0.0
        state.heat[:] = 0.0
    state.refused[0] = refused


@inlined
def _test_sensor(state, u, k, i, scores):
    """Test sensor i; return whether anything about it fails."""
    refused, test = _is_refused(u, k, i), _OF_SENSOR * i
    came = np.isfinite(u.nu[k, i])
    if came and not refused:
        _average(state, i, min(max(u.nu[k, i] / u.nu_sigma[k, i], -_CLIP), _CLIP), u.time_s[k])
    _scores(state, i, scores)
    last, long = state.sensor[i, 0], state.sensor[i, 1]
    mean = long[0] if abs(long[0]) / _BIAS[1] > abs(last[0]) / _BIAS[0] else last[0]
    product, square = max(last[1], long[1]), max(last[2], long[2])
    _note(state, test, scores[0], u.time_s[k], mean, 0.0)
    _note(state, test + 1, scores[1], u.time_s[k], product, 0.0)
    _note(state, test + 2, scores[2], u.time_s[k], np.sqrt(max(square, 0.0)), 1.0)
    if came or not refused:
        _note(state, test + 3, 2.0 if refused else 0.0, u.time_s[k], u.nu[k, i], u.nu_sigma[k, i])
    failing = False
    for j in range(_OF_SENSOR):
        failing = failing or _fails(state, test + j)
    return failing


@inlined
def _distance(state, u, k, j, uncertainty):
    """How far heat j is from its law, in what law and estimate are trusted for."""
    law_W = u.law_W[k, j]
    state.peak_W[j] = max(state.peak_W[j] * np.exp(-u.dt_s[k] / _PEAK_S), abs(law_W))
    trusted_W, floor_W = uncertainty * abs(law_W), _LEAST_W + _FLOOR * state.peak_W[j]
    return (u.heat_W[k, j] - law_W) / np.sqrt(u.heat_sigma_W[k, j] ** 2 + trusted_W**2 + floor_W**2)


@inlined
def _test_heats(state, u, k, trust, base):
    """Test every heat and all of them together; return whether one fails, and whether one is not known."""
    m_e, total, laws, failing, starting = u.heat_W.shape[1], 0.0, 0, False, False
    for j in range(m_e):
        sigma_W, test = u.heat_sigma_W[k, j], base + _OF_HEAT * j
        unknown = sigma_W > _KNOWN * trust.initial_W[j]
        _note(state, test, 2.0 if unknown else 0.0, u.time_s[k], sigma_W, trust.initial_W[j])
        starting = starting or unknown
        if np.isnan(trust.law_uncertainty[j]):
            continue
        distance = _distance(state, u, k, j, trust.law_uncertainty[j])
        total, laws = total + distance, laws + 1
        score = _off_law(state, j, distance, u.dt_s[k], _OFF_LAW)
        _note(state, test + 1, score, u.time_s[k], u.heat_W[k, j], u.law_W[k, j])
        failing = failing or _fails(state, test + 1)
    if laws > 1:
        score = _off_law(state, m_e, total / np.sqrt(laws), u.dt_s[k], _ALL_OFF_LAW)
        _note(state, base + _OF_HEAT * m_e, score, u.time_s[k], state.heat[m_e, 0], 0.0)
        failing = failing or _fails(state, base + _OF_HEAT * m_e)
    return failing, starting


@cached_call
def _test(u, trust, state, quality):
    """Run the tests over K steps; `state` and `quality` are changed in place."""
    s, m_e = u.nu.shape[1], u.heat_W.shape[1]
    scores = np.zeros(3)
    for k in range(len(u.time_s)):
        if quality[k] == ESTIMATE_INVALID:
            continue
        _forget_after_refusals(state, u, k)
        failing, starting = _test_heats(state, u, k, trust, _OF_SENSOR * s)
        for i in range(s):
            failing = _test_sensor(state, u, k, i, scores) or failing
        for i in range(u.motion.shape[1]):
            ratio, test = u.motion[k, i], _OF_SENSOR * s + _OF_HEAT * m_e + 1 + i
            score = 0.0 if np.isnan(ratio) else max(ratio / DISAGREE, FALLS_SHORT / max(ratio, 1e-9))
            _note(state, test, score, u.time_s[k], ratio, 1.0)
            failing = failing or _fails(state, test)
        if failing:
            quality[k] = max(quality[k], ESTIMATE_DEGRADED)
        elif starting:
            quality[k] = max(quality[k], ESTIMATE_STARTING)
