"""A self-test that always runs (see `observer.estimators.selftest`): the tests, step by step."""

from __future__ import annotations

from observer.kernels.codes import (
    ESTIMATE_DEGRADED,
    ESTIMATE_INVALID,
    ESTIMATE_STARTING,
    EXCLUDED,
    GOOD,
    NUT_LOST,
    REJECTED,
)
from observer.kernels.covariance import squared
from observer.kernels.libc import NAN, exp, isfinite, isnan, sqrt

# The windows' time constants, and which means over each are more than chance and small faults make.
WINDOWS_S = [60.0, 600.0]
_SURE_SE = 6.0  # standard errors
_BIAS = [0.4, 0.25]  # of σ
_COLOUR = [0.35, 0.25]  # lag-one correlation
_LASTING = 2.0  # standard deviations of what stays from sample to sample, where tolerances allow for it
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
# A position that leaps, in m and in what it usually leaves beside speed times lead, after so many samples …
_LEAP_M, _LEAP_USUAL, _LEAP_SAMPLES = 0.005, 8.0, 30.0
# … between samples that are no further apart; and within what part a way is the whole of what is allowed.
_LEAP_S, _WHOLE = 5.0, 0.05
_STAYS_LATE_S = 15.0  # for how long samples that were held up may go on coming as late
_UNUSUAL = 0.1  # part by which a time between two samples counts at most for what is usual

DISAGREE = 1.5
"""Ratio of the way a nut makes to what speed and lead allow, beyond which the two disagree …"""
FALLS_SHORT = 0.5
"""… and below which they do; samples cut reversals off, so a way may well fall short."""

# What is remembered of a nut's way beside the first five: the last whole way made at a steady speed, one that
# fell short after it, what samples usually leave, by how much the position has leapt, how many samples there
# were; the largest way between samples of standstill, and how many of these there were; the leap, if way and
# speed have disagreed since; the usual time between samples, and for how long samples may have been held up.
WAS, SHORT, USUAL, LEAP, SAMPLES, HIDDEN, STOOD, ASTRAY, EVERY_S, LATE_S = 5, 6, 7, 8, 9, 10, 11, 12, 13, 14
OF_MOTION = 15
OF_SENSOR, OF_HEAT = 4, 2
"""How many tests a sensor and a heat have."""


def compare_ways(sample_s, sample_m, offset, driven_m_s, stroke_m, memory, ratio, leap_m, degraded):
    """After each of K steps the way a nut made lately over what speed and lead allow, NaN if too little, and
    by how much its position has leapt.

    Where the two disagree, or the position has leapt, the place of the nut is not known.
    """
    for k in range(len(ratio)):
        for i in range(offset[k], offset[k + 1]):
            since_s = sample_s[i] - memory[2]
            allowed_m = 0.5 * (driven_m_s[i] + memory[4]) * since_s
            _look_for_leap(memory, sample_m[i] - memory[3], driven_m_s[i], since_s)
            if 0.0 < since_s < 10.0 and 2.5 * allowed_m <= stroke_m:
                fade = exp(-since_s / _MOTION_S)
                memory[0] = fade * memory[0] + abs(sample_m[i] - memory[3])
                memory[1] = fade * memory[1] + allowed_m
            memory[2], memory[3], memory[4] = sample_s[i], sample_m[i], driven_m_s[i]
        ratio[k] = NAN
        if max(memory[0], memory[1]) >= _MOTION_ENOUGH * stroke_m:
            ratio[k] = memory[0] / max(memory[1], 1e-6 * stroke_m)
        leap_m[k] = memory[LEAP]
        if ratio[k] > DISAGREE or ratio[k] < FALLS_SHORT:
            memory[ASTRAY] = memory[LEAP]
            degraded[k] = NUT_LOST
        if memory[LEAP] != 0.0:
            degraded[k] = NUT_LOST


def _look_for_leap(memory, way_m, driven_m_s, since_s):
    """Take in the way between two samples; where no motion explains it, the position has leapt.

    Beyond what the faster of both speeds allows it has; short of what a steady speed makes it has if the
    nut went on the same way before and after: it cannot have turned twice. A leap back undoes it, and
    any leap where way and speed have disagreed since. A sample may come late: what the times between samples
    have been longer than usual, and those after it not yet shorter, it says where the nut was before.
    """
    if not (0.0 < since_s <= _LEAP_S) or isnan(driven_m_s) or isnan(memory[4]) or isnan(way_m):
        memory[WAS], memory[SHORT], memory[LATE_S] = 0.0, 0.0, 0.0
        return
    before_s = exp(-since_s / _STAYS_LATE_S) * memory[LATE_S]
    held_up_s = since_s - memory[EVERY_S] if memory[SAMPLES] > 0.0 else 0.0
    memory[LATE_S] = max(before_s + held_up_s, 0.0)
    longer_s = since_s - memory[EVERY_S]
    if memory[SAMPLES] >= _LEAP_SAMPLES:  # neither a pause nor what comes at once after it is usual
        longer_s = min(max(longer_s, -_UNUSUAL * memory[EVERY_S]), _UNUSUAL * memory[EVERY_S])
    memory[EVERY_S] += longer_s / min(memory[SAMPLES] + 1.0, 64.0)
    late_m = max(driven_m_s, memory[4]) * max(before_s, memory[LATE_S])
    most_m = max(driven_m_s, memory[4]) * since_s
    if driven_m_s == 0.0 and memory[4] == 0.0:  # it may have moved between two samples of the speed, …
        most_m = memory[HIDDEN] if memory[STOOD] >= _LEAP_SAMPLES else abs(way_m)  # … as it did before
        memory[HIDDEN] = max(memory[HIDDEN], abs(way_m))
        memory[STOOD] += 1.0
    least_m = max(_LEAP_M, _LEAP_USUAL * memory[USUAL]) + late_m
    beyond_m = abs(way_m) - most_m
    steady = most_m > least_m and abs(driven_m_s - memory[4]) <= _WHOLE * driven_m_s
    whole = steady and beyond_m > -_WHOLE * most_m - _LEAP_M - late_m
    leap_m, short_m = 0.0, memory[SHORT]
    if short_m != 0.0 and whole and way_m * memory[WAS] > 0.0:
        leap_m = short_m
    memory[SHORT] = 0.0
    if memory[SAMPLES] >= _LEAP_SAMPLES and beyond_m > least_m:
        leap_m += beyond_m if way_m > 0.0 else -beyond_m
    elif memory[SAMPLES] >= _LEAP_SAMPLES and steady and short_m == 0.0 and memory[WAS] != 0.0 and not whole:
        memory[SHORT] = way_m - (most_m if memory[WAS] > 0.0 else -most_m)
    if leap_m != 0.0:
        back = memory[ASTRAY] != 0.0
        memory[LEAP] += leap_m
        if back or abs(memory[LEAP]) <= 2.0 * least_m:
            memory[LEAP], memory[ASTRAY] = 0.0, 0.0
    else:
        usual_m = max(beyond_m - late_m, 0.0)
        memory[USUAL] += (usual_m - memory[USUAL]) / max(min(memory[SAMPLES], 64.0), 1.0)
    if memory[SHORT] == 0.0:
        memory[WAS] = way_m if whole and leap_m == 0.0 else 0.0
    memory[SAMPLES] += 1.0


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


def _average_innovation(state, i, nu, lasting, time_s):
    """Take a normalised innovation of sensor i, and the part of its variance that lasts, into their means."""
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
        state.sensor[i, w, 4] += share * (lasting - state.sensor[i, w, 4])


def _scores(state, i, scores):
    """The scores of sensor i: bias, colour, noise; a clean minute makes the longer window forget.

    Of an innovation's variance S that part lasts from sample to sample which is not the reading's own noise,
    ρ = 1 - R/S: where the filter allows for tolerances, bias and colour are what lies beyond 2 √ρ and 4 ρ.
    """
    for q in range(3):
        scores[q] = 0.0
    for w in range(2):
        mean, product, square = state.sensor[i, w, 0], state.sensor[i, w, 1], state.sensor[i, w, 2]
        sure = 1.0 / (_SURE_SE * sqrt(max(state.sensor[i, w, 3], 1e-300)))
        lasting = _LASTING * sqrt(state.sensor[i, w, 4])
        scores[0] = max(scores[0], min(abs(mean) * sure, abs(mean) / (_BIAS[w] + lasting)))
        scores[1] = max(scores[1], min(product * sure, product / (_COLOUR[w] + lasting * lasting)))
        scores[2] = max(scores[2], min((square - 1.0) * sure / sqrt(2.0), (square - 1.0) / _NOISE))
    lasting = _LASTING * sqrt(state.sensor[i, 0, 4])
    clean = abs(state.sensor[i, 0, 0]) < _CLEAN * (_BIAS[0] + lasting)
    clean = clean and state.sensor[i, 0, 1] < _CLEAN * (_COLOUR[0] + lasting * lasting)
    if (
        clean
        and state.sensor[i, 0, 2] < 1.0 + _CLEAN * _NOISE
        and max(scores[0], scores[1], scores[2]) >= 1.0
    ):
        for q in range(3):
            state.sensor[i, 1, q] = state.sensor[i, 0, q]


def _off_law(state, row, distance, dt_s, limit, slack):
    """Take in how far a heat is from its law; return the score; limits are `slack` times as wide."""
    score = 0.0
    clipped = min(max(distance, -_CLIP_LAW), _CLIP_LAW)
    for w in range(2):
        state.heat[row, w] += (1.0 - exp(-dt_s / _LAW_WINDOWS_S[w])) * (clipped - state.heat[row, w])
        score = max(score, abs(state.heat[row, w]) / (slack * limit[w]))
    if score >= 1.0 and abs(state.heat[row, 0]) < _CLEAN * slack * limit[0]:
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
                for q in range(5):
                    state.sensor[i, w, q] = 0.0
        for i in range(state.heat.shape[0]):
            for w in range(2):
                state.heat[i, w] = 0.0
    state.refused[0] = refused


def _test_sensor(state, u, k, i, trust, scores):
    """Test sensor i; return whether anything about it fails. One that is excluded is not tested."""
    refused, test = _is_refused(u, k, i), OF_SENSOR * i
    if u.sensor_quality[k, i] == EXCLUDED:
        for j in range(OF_SENSOR):
            state.since_s[test + j] = NAN
        for w in range(2):
            for q in range(5):
                state.sensor[i, w, q] = 0.0
        return False
    came = isfinite(u.nu[k, i])
    if came and not refused:
        nu = min(max(u.nu[k, i] / u.nu_sigma[k, i], -_CLIP), _CLIP)
        lasting = max(0.0, 1.0 - squared(trust.noise_K[i] / u.nu_sigma[k, i]))
        _average_innovation(state, i, nu, lasting, u.time_s[k])
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
        score = _off_law(state, j, distance, u.dt_s[k], _OFF_LAW, trust.law_slack)
        _note(state, test + 1, score, u.time_s[k], u.heat_W[k, j], u.law_W[k, j])
        failing = failing or _fails(state, test + 1)
    if laws > 1:
        score = _off_law(state, m_e, total / sqrt(laws), u.dt_s[k], _ALL_OFF_LAW, trust.law_slack)
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
            failing = _test_sensor(state, u, k, i, trust, scores) or failing
        nuts = u.motion.shape[1] // 2
        for i in range(nuts):
            ratio, test = u.motion[k, i], OF_SENSOR * s + OF_HEAT * m_e + 1 + i
            score = 0.0 if isnan(ratio) else max(ratio / DISAGREE, FALLS_SHORT / max(ratio, 1e-9))
            _note(state, test, score, u.time_s[k], ratio, 1.0)
            failing = failing or _fails(state, test)
            leap_m, test = u.motion[k, nuts + i], test + nuts
            _note(state, test, 0.0 if leap_m == 0.0 else 2.0, u.time_s[k], leap_m, 0.0)
            failing = failing or _fails(state, test)
        if failing:
            quality[k] = max(quality[k], ESTIMATE_DEGRADED)
        elif starting:
            quality[k] = max(quality[k], ESTIMATE_STARTING)
