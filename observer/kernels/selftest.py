"""A self-test that always runs (see `observer.estimators.selftest`): the tests, step by step."""

from __future__ import annotations

from observer.kernels.arithmetic import squared
from observer.kernels.codes import (
    ESTIMATE_DEGRADED,
    ESTIMATE_INVALID,
    ESTIMATE_STARTING,
    GOOD,
    NUT_LOST,
    REJECTED,
)
from observer.kernels.libm import NAN, exp, isfinite, isnan, sqrt

# The windows' time constants, and which means over each are more than chance and small faults make.
WINDOWS_S = [60.0, 600.0]
_SURE_SE = 6.0  # standard errors
_BIAS = [0.4, 0.25]  # of σ
_COLOUR = [0.35, 0.25]  # lag-one correlation
_NOISE = 1.5  # of σ², beyond the one that is expected
_LAW_WINDOWS_S = [15.0, 600.0]
_OFF_LAW = [3.0, 2.5]  # of what law and estimate are trusted for …
_ALL_OFF_LAW = [2.5, 2.0]  # … and of all of them together
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

OF_SENSOR, OF_HEAT = 4, 2
"""How many tests a sensor and a heat have."""


def compare_ways(sample_s, sample_m, offset, driven_m_s, stroke_m, memory, ratio, degraded):
    """After each of K steps the way a nut made lately over what speed and lead allow; NaN if too little.

    Where the two disagree, the place of the nut is not known.
    """
    for k in range(len(ratio)):
        for i in range(offset[k], offset[k + 1]):
            since_s = sample_s[i] - memory[2]
            allowed_m = 0.5 * (driven_m_s[i] + memory[4]) * since_s
            if 0.0 < since_s < 10.0 and 2.5 * allowed_m <= stroke_m:
                fade = exp(-since_s / _MOTION_S)
                memory[0] = fade * memory[0] + abs(sample_m[i] - memory[3])
                memory[1] = fade * memory[1] + allowed_m
            memory[2], memory[3], memory[4] = sample_s[i], sample_m[i], driven_m_s[i]
        ratio[k] = NAN
        if max(memory[0], memory[1]) >= _MOTION_ENOUGH * stroke_m:
            ratio[k] = memory[0] / max(memory[1], 1e-6 * stroke_m)
        if ratio[k] > DISAGREE or ratio[k] < FALLS_SHORT:
            degraded[k] = NUT_LOST


def _note(state, test, score, time_s, value, expected):
    """Note how a test stands, by its score: 1 and more fails, and below `_CLEAR` passes again."""
    failing = not isnan(state.since_s[test])
    if score >= 1.0 or (failing and score >= _CLEAR):
        if not failing:
            state.since_s[test] = time_s
        if state.steps[test] == 0.0:
            state.first_s[test] = time_s
        state.steps[test] += 1.0
        state.value[test], state.expected[test] = value, expected
    else:
        state.since_s[test] = NAN


def _average_innovation(state, i, nu, time_s):
    """Take a normalised innovation of sensor i into its means."""
    before, since_s = state.last[i, 0], time_s - state.last[i, 1]
    state.last[i, 0], state.last[i, 1] = nu, time_s
    if not since_s > 0.0:
        return
    for w in range(2):
        share = 1.0 - exp(-since_s / WINDOWS_S[w])
        state.sensor[i, w, 0] += share * (nu - state.sensor[i, w, 0])
        state.sensor[i, w, 1] += share * (nu * before - state.sensor[i, w, 1])
        state.sensor[i, w, 2] += share * (nu * nu - state.sensor[i, w, 2])
        state.sensor[i, w, 3] = squared(1.0 - share) * state.sensor[i, w, 3] + share * share


def _scores(state, i, scores):
    """The scores of sensor i: bias, colour, noise; a clean minute makes the longer window forget."""
    for q in range(3):
        scores[q] = 0.0
    for w in range(2):
        mean, product, square = state.sensor[i, w, 0], state.sensor[i, w, 1], state.sensor[i, w, 2]
        sure = 1.0 / (_SURE_SE * sqrt(max(state.sensor[i, w, 3], 1e-300)))
        scores[0] = max(scores[0], min(abs(mean) * sure, abs(mean) / _BIAS[w]))
        scores[1] = max(scores[1], min(product * sure, product / _COLOUR[w]))
        scores[2] = max(scores[2], min((square - 1.0) * sure / sqrt(2.0), (square - 1.0) / _NOISE))
    clean = abs(state.sensor[i, 0, 0]) < _CLEAN * _BIAS[0] and state.sensor[i, 0, 1] < _CLEAN * _COLOUR[0]
    if (
        clean
        and state.sensor[i, 0, 2] < 1.0 + _CLEAN * _NOISE
        and max(scores[0], scores[1], scores[2]) >= 1.0
    ):
        for q in range(3):
            state.sensor[i, 1, q] = state.sensor[i, 0, q]


def _off_law(state, row, distance, dt_s, limit):
    """Take in how far a heat is from its law; return the score."""
    score = 0.0
    clipped = min(max(distance, -_CLIP_LAW), _CLIP_LAW)
    for w in range(2):
        state.heat[row, w] += (1.0 - exp(-dt_s / _LAW_WINDOWS_S[w])) * (clipped - state.heat[row, w])
        score = max(score, abs(state.heat[row, w]) / limit[w])
    if score >= 1.0 and abs(state.heat[row, 0]) < _CLEAN * limit[0]:
        state.heat[row, 1] = state.heat[row, 0]
    return score


def _fails(state, test):
    """Whether a test fails now."""
    return not isnan(state.since_s[test])


def _is_refused(u, k, i):
    """Whether sensor i was good when it came, and refused by the gate."""
    return u.given[k, i] == GOOD and u.sensor_quality[k, i] == REJECTED


def _forget_after_refusals(state, u, k):
    """Begin the means afresh when no sensor is refused any more: the state has been another one since."""
    refused = 0.0
    for i in range(u.nu.shape[1]):
        if _is_refused(u, k, i):
            refused = 1.0
    if refused == 0.0 and state.refused[0] > 0.0:
        for i in range(state.sensor.shape[0]):
            for w in range(2):
                for q in range(4):
                    state.sensor[i, w, q] = 0.0
        for i in range(state.heat.shape[0]):
            for w in range(2):
                state.heat[i, w] = 0.0
    state.refused[0] = refused


def _test_sensor(state, u, k, i, scores):
    """Test sensor i; return whether anything about it fails."""
    refused, test = _is_refused(u, k, i), OF_SENSOR * i
    came = isfinite(u.nu[k, i])
    if came and not refused:
        _average_innovation(state, i, min(max(u.nu[k, i] / u.nu_sigma[k, i], -_CLIP), _CLIP), u.time_s[k])
    _scores(state, i, scores)
    last, long = state.sensor[i, 0, 0], state.sensor[i, 1, 0]
    mean = long if abs(long) / _BIAS[1] > abs(last) / _BIAS[0] else last
    product = max(state.sensor[i, 0, 1], state.sensor[i, 1, 1])
    square = max(state.sensor[i, 0, 2], state.sensor[i, 1, 2])
    _note(state, test, scores[0], u.time_s[k], mean, 0.0)
    _note(state, test + 1, scores[1], u.time_s[k], product, 0.0)
    _note(state, test + 2, scores[2], u.time_s[k], sqrt(max(square, 0.0)), 1.0)
    if came or not refused:
        _note(state, test + 3, 2.0 if refused else 0.0, u.time_s[k], u.nu[k, i], u.nu_sigma[k, i])
    failing = False
    for j in range(OF_SENSOR):
        failing = failing or _fails(state, test + j)
    return failing


def _distance(state, u, k, j, uncertainty):
    """How far heat j is from its law, in what law and estimate are trusted for."""
    law_W = u.law_W[k, j]
    state.peak_W[j] = max(state.peak_W[j] * exp(-u.dt_s[k] / _PEAK_S), abs(law_W))
    trusted_W, floor_W = uncertainty * abs(law_W), _LEAST_W + _FLOOR * state.peak_W[j]
    return (u.heat_W[k, j] - law_W) / sqrt(
        squared(u.heat_sigma_W[k, j]) + squared(trusted_W) + squared(floor_W)
    )


def _test_heats(state, u, k, trust, base):
    """Test every heat and all of them together; return whether one fails, and whether one is not known."""
    m_e, total, laws, failing, starting = u.heat_W.shape[1], 0.0, 0, False, False
    for j in range(m_e):
        sigma_W, test = u.heat_sigma_W[k, j], base + OF_HEAT * j
        unknown = sigma_W > _KNOWN * trust.initial_W[j]
        _note(state, test, 2.0 if unknown else 0.0, u.time_s[k], sigma_W, trust.initial_W[j])
        starting = starting or unknown
        if isnan(trust.law_uncertainty[j]):
            continue
        distance = _distance(state, u, k, j, trust.law_uncertainty[j])
        total, laws = total + distance, laws + 1
        score = _off_law(state, j, distance, u.dt_s[k], _OFF_LAW)
        _note(state, test + 1, score, u.time_s[k], u.heat_W[k, j], u.law_W[k, j])
        failing = failing or _fails(state, test + 1)
    if laws > 1:
        score = _off_law(state, m_e, total / sqrt(laws), u.dt_s[k], _ALL_OFF_LAW)
        _note(state, base + OF_HEAT * m_e, score, u.time_s[k], state.heat[m_e, 0], 0.0)
        failing = failing or _fails(state, base + OF_HEAT * m_e)
    return failing, starting


def run_selftest(u, trust, state, quality, scores):
    """Run the tests over K steps; `state` and `quality` are changed in place; `scores` (3,) is scratch."""
    s, m_e = u.nu.shape[1], u.heat_W.shape[1]
    for k in range(len(u.time_s)):
        if quality[k] == ESTIMATE_INVALID:
            continue
        _forget_after_refusals(state, u, k)
        failing, starting = _test_heats(state, u, k, trust, OF_SENSOR * s)
        for i in range(s):
            failing = _test_sensor(state, u, k, i, scores) or failing
        for i in range(u.motion.shape[1]):
            ratio, test = u.motion[k, i], OF_SENSOR * s + OF_HEAT * m_e + 1 + i
            score = 0.0 if isnan(ratio) else max(ratio / DISAGREE, FALLS_SHORT / max(ratio, 1e-9))
            _note(state, test, score, u.time_s[k], ratio, 1.0)
            failing = failing or _fails(state, test)
        if failing:
            quality[k] = max(quality[k], ESTIMATE_DEGRADED)
        elif starting:
            quality[k] = max(quality[k], ESTIMATE_STARTING)
