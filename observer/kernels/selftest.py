"""A self-test that always runs (see `observer.estimators.selftest`): the tests, step by step."""

from __future__ import annotations

from observer.kernels.codes import (
    ESTIMATE_DEGRADED,
    ESTIMATE_INVALID,
    ESTIMATE_STARTING,
    EXCLUDED,
    GOOD,
    HEAT,
    NUT_LOST,
    REJECTED,
)
from observer.kernels.covariance import squared
from observer.kernels.libc import INFINITY, NAN, exp, isfinite, isnan, sqrt

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
KNOWN = 0.6  # part of its prior below which a σ must be for a heat, the field or the error to be known
_PEAK_S = 3600.0  # for how long the largest heat by a law counts for what the law is trusted for …
_FLOOR = 0.05  # … by this part of it
_LEAST_W = 0.3
_MOTION_S = 20.0
_MOTION_ENOUGH = 1.0  # strokes

GREATEST_ACCELERATION_m_s2 = 12.0
"""No nut accelerates faster (1 g, and a fifth)."""
GREATEST_SPEED_m_s = 1.2
"""No nut is faster (60 m/min, and a fifth), unless its speed channel says so."""
SKEW_S = 0.025
"""A register scan reads speed and position so far apart at most."""
ROUNDED_m, _WAY_SHARE = 0.002, 0.03  # by rounding, and by an inexact lead
_SAMPLES_FIRST = 30.0  # samples of a turning screw before anything is judged
_LATENESS_FADES_S = 3.0
_STOPPED_S = 2.0  # a process that was late by more has stood still; the ways it reads then are not compared
_UNEXPLAINED = 2.0  # a difference of ways is judged beyond so many times what the polls leave open
_LONGEST_REFRESH_S = 0.25  # a position that repeats for longer on a turning screw is stuck
_UNUSUAL = 0.1  # part by which one time between samples moves the usual one at most
_OPEN_S = 40.0  # for so long the field is opened after a jump by the whole travel
_AGREE_S, _AGREE_TRAVELS = 600.0, 2.0  # time and way with which temperatures confirm a position

DISAGREE = 1.5
"""Ratio of the way a nut makes to what speed and lead allow, beyond which the two disagree …"""
FALLS_SHORT = 0.5
"""… and below which they do; samples cut reversals off, so a way may well fall short."""

# The memory of a nut's motion. Lately: the way made and the way that the speed allows, in m. The last sample:
# its time, position, speed and how old that speed was.
MADE_m, ALLOWED_m, AT_S, PLACE_m, SPEED_m_s, SPEED_AGE_S = 0, 1, 2, 3, 4, 5
# When polls come: samples of a turning screw, the usual time between samples, by how much the last one may
# be late after a longer time, by how much all may be late. For how long, and by what turned way, the position
# has repeated on a turning screw; the slowest refresh of its register.
SAMPLES, USUAL_S, LATER_S, LATE_S, REPEATS_S, REPEATS_m, REFRESH_S = 6, 7, 8, 9, 10, 11, 12
# Jumps: their sum, since when, whether way and speed have disagreed since the last, the travel before it.
JUMP_m, JUMPED_S, DISAGREED, LOWEST_m, HIGHEST_m = 13, 14, 15, 16, 17
# The jump that temperatures are compared with, and for what time and way they have agreed; the variance in m²
# of the recent way that polls leave open, and the most that they leave open, in m.
JUDGED_m, AGREED_S, AGREED_TRAVELS, OPEN_m2, OPEN_m = 18, 19, 20, 21, 22
OF_MOTION = 23
RATIO, JUMP, WAY = 0, 1, 2
OF_NUT = 3
"""What each step says of a nut: the ratio of ways, the sum of its jumps in m, and its way in travels."""
OF_SENSOR, OF_HEAT = 4, 2
"""How many tests a sensor and a heat have."""


def compare_ways(sample_s, sample_m, offset, driven_m_s, speed_age_s, travel_m, memory, motion, degraded):
    """Fill in what the nut's samples say of each of K steps (see `OF_NUT`).

    Where way and speed disagree, and for a time after a jump, the nut's position is lost.
    """
    stroke_m = travel_m[1] - travel_m[0]
    for k in range(len(motion)):
        motion[k, WAY] = 0.0
        for i in range(offset[k], offset[k + 1]):
            since_s, way_m = sample_s[i] - memory[AT_S], sample_m[i] - memory[PLACE_m]
            allowed_m = 0.5 * (driven_m_s[i] + memory[SPEED_m_s]) * since_s
            jumped = False
            if since_s > 0.0 and isfinite(way_m):
                jumped = _look_for_jump(memory, sample_s[i], way_m, driven_m_s[i], speed_age_s[i])
            if jumped:
                memory[MADE_m], memory[ALLOWED_m] = 0.0, 0.0
                memory[OPEN_m2], memory[OPEN_m] = 0.0, 0.0
            elif 0.0 < since_s < 10.0 and 2.5 * allowed_m <= stroke_m and memory[LATE_S] <= _STOPPED_S:
                motion[k, WAY] += abs(way_m) / stroke_m
                fade = exp(-since_s / _MOTION_S)
                memory[MADE_m] = fade * memory[MADE_m] + abs(way_m)
                memory[ALLOWED_m] = fade * memory[ALLOWED_m] + allowed_m
                open_m = longest_way(memory[SPEED_m_s], driven_m_s[i], 0.0, since_s) - allowed_m
                memory[OPEN_m2] = squared(fade) * memory[OPEN_m2] + squared(open_m)
                memory[OPEN_m] = fade * memory[OPEN_m] + open_m
            memory[AT_S], memory[PLACE_m] = sample_s[i], sample_m[i]
            memory[SPEED_m_s], memory[SPEED_AGE_S] = driven_m_s[i], speed_age_s[i]
            _compare_with_travel(memory, travel_m)
        motion[k, RATIO] = NAN
        # polls in step with a motion to and fro miss all of its speed: a long way is judged by the most
        farther_m = memory[MADE_m] - memory[ALLOWED_m] - memory[OPEN_m]
        shorter_m = memory[ALLOWED_m] - memory[MADE_m] - _UNEXPLAINED * sqrt(memory[OPEN_m2])
        if max(memory[MADE_m], memory[ALLOWED_m]) >= _MOTION_ENOUGH * stroke_m and (
            farther_m > 0.0 or shorter_m > 0.0
        ):
            motion[k, RATIO] = memory[MADE_m] / max(memory[ALLOWED_m], 1e-6 * stroke_m)
        motion[k, JUMP] = memory[JUMP_m]
        if motion[k, RATIO] > DISAGREE or motion[k, RATIO] < FALLS_SHORT:
            memory[DISAGREED] = 1.0
            degraded[k] = NUT_LOST
        open_s = _OPEN_S * min(1.0, abs(memory[JUMP_m]) / stroke_m)
        if memory[JUMP_m] != 0.0 and memory[AT_S] - memory[JUMPED_S] <= open_s:
            degraded[k] = NUT_LOST


def longest_way(before_m_s, after_m_s, unsure_m_s, elapsed_s):
    """Return the longest way in m that a nut can make in a time between two speeds.

    It accelerates as fast as any nut and brakes as fast: half of the change of direction is
    (a T² - Δv²/a)/4 beyond the mean of both speeds, which are `unsure_m_s` apart from those read.
    """
    change_m_s = max(abs(after_m_s - before_m_s) - 2.0 * unsure_m_s, 0.0)
    gained_m = (
        squared(elapsed_s) * GREATEST_ACCELERATION_m_s2 - squared(change_m_s) / GREATEST_ACCELERATION_m_s2
    )
    way_m = (0.5 * (before_m_s + after_m_s) + unsure_m_s) * elapsed_s + 0.25 * max(gained_m, 0.0)
    return min(way_m, max(GREATEST_SPEED_m_s, before_m_s, after_m_s) * elapsed_s)


def _look_for_jump(memory, time_s, way_m, driven_m_s, speed_age_s):
    """Add a way that no motion explains to the jumps, and return whether there was one.

    A jump back to where the nut was ends them, as does any after way and speed have disagreed.
    """
    since_s, before_m_s = time_s - memory[AT_S], memory[SPEED_m_s]
    late_s = max(memory[LATER_S], min(memory[LATE_S], max(memory[USUAL_S] - since_s, 0.0)))
    repeats_s = memory[REPEATS_S] if memory[REPEATS_m] > ROUNDED_m else 0.0
    elapsed_s = since_s + max(late_s, repeats_s, memory[REFRESH_S])
    unsure_m_s = GREATEST_ACCELERATION_m_s2 * (SKEW_S + max(speed_age_s, memory[SPEED_AGE_S]))
    allowed_m = longest_way(before_m_s, driven_m_s, unsure_m_s, elapsed_s)
    allowed_m += ROUNDED_m + _WAY_SHARE * max(before_m_s, driven_m_s) * elapsed_s
    _time_the_poll(memory, since_s, way_m, min(before_m_s, driven_m_s))
    if isnan(allowed_m) or memory[SAMPLES] < _SAMPLES_FIRST or abs(way_m) <= allowed_m:
        return False
    mean_m = 0.5 * (before_m_s + driven_m_s) * since_s
    jump_m = memory[JUMP_m] + way_m - (mean_m if way_m > 0.0 else -mean_m)
    if memory[DISAGREED] != 0.0 or abs(jump_m) <= allowed_m:
        jump_m = 0.0
    memory[JUMP_m], memory[JUMPED_S], memory[DISAGREED] = jump_m, time_s, 0.0
    return True


def _time_the_poll(memory, since_s, way_m, driven_m_s):
    """Take in when a sample came: the usual time between samples, lateness, refresh of the register."""
    if memory[SAMPLES] == 0.0:
        memory[USUAL_S] = since_s
    longer_s = since_s - memory[USUAL_S]
    memory[LATE_S] = max(exp(-since_s / _LATENESS_FADES_S) * memory[LATE_S] + longer_s, 0.0)
    memory[LATER_S] = memory[LATE_S] if longer_s > _UNUSUAL * memory[USUAL_S] else 0.0
    most_s = _UNUSUAL * memory[USUAL_S] if memory[SAMPLES] >= _SAMPLES_FIRST else since_s
    memory[USUAL_S] += min(max(longer_s, -most_s), most_s) / min(memory[SAMPLES] + 1.0, 64.0)
    if driven_m_s > 0.0:
        memory[SAMPLES] += 1.0
    if way_m == 0.0 and driven_m_s > 0.0:
        memory[REPEATS_S] += since_s
        memory[REPEATS_m] += driven_m_s * since_s
        return
    if memory[REPEATS_S] <= _LONGEST_REFRESH_S and memory[REPEATS_m] > ROUNDED_m:
        memory[REFRESH_S] = max(memory[REFRESH_S], memory[REPEATS_S])
    memory[REPEATS_S], memory[REPEATS_m] = 0.0, 0.0


def _compare_with_travel(memory, travel_m):
    """Take a jump back if it would place the nut beyond the ends of its travel: then it was motion."""
    place_m, jump_m = memory[PLACE_m], memory[JUMP_m]
    if jump_m == 0.0:
        memory[LOWEST_m] = min(memory[LOWEST_m], place_m, travel_m[0])
        memory[HIGHEST_m] = max(memory[HIGHEST_m], place_m, travel_m[1])
        return
    beyond_m = max(memory[LOWEST_m] - (place_m - jump_m), (place_m - jump_m) - memory[HIGHEST_m])
    if beyond_m > 0.5 * abs(jump_m):
        memory[JUMP_m] = 0.0


def jump_stands(memory, step, dt_s, agree):
    """Return whether a nut's jump is still to be reported.

    Temperatures confirm the position if they have agreed with the model since the jump, for long enough while
    the nut moved. If they have disagreed once since, they can do so no more: the heats may have adapted.
    """
    if step[JUMP] != memory[JUDGED_m]:
        memory[JUDGED_m], memory[AGREED_S], memory[AGREED_TRAVELS] = step[JUMP], 0.0, 0.0
    confirmed = memory[AGREED_S] >= _AGREE_S and memory[AGREED_TRAVELS] >= _AGREE_TRAVELS
    if step[JUMP] != 0.0 and not confirmed:
        memory[AGREED_S] = memory[AGREED_S] + dt_s if agree else -INFINITY
        memory[AGREED_TRAVELS] += step[WAY]
    return step[JUMP] != 0.0 and not confirmed


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
        needed_W = KNOWN * trust.initial_W[j]
        unknown = sigma_W > needed_W
        _note(state, test, 2.0 if unknown else 0.0, u.time_s[k], sigma_W, needed_W)
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


def _is_any_used(u, k):
    """Whether the estimate of step k used a sensor."""
    for i in range(u.sensor_quality.shape[1]):
        if u.sensor_quality[k, i] == GOOD:
            return True
    return False


def run_selftest(u, trust, state, quality, part_quality, scores):
    """Run the tests over K steps; `state`, `quality` (K,) and `part_quality` (K, 3) are changed in place;
    `scores` (3,) is scratch. A heat that is not known yet lowers the quality of the heats alone.
    """
    s, m_e = u.nu.shape[1], u.heat_W.shape[1]
    for k in range(len(u.time_s)):
        if quality[k] == ESTIMATE_INVALID:
            continue
        _forget_after_refusals(state, u, k)
        failing, starting = _test_heats(state, u, k, trust, OF_SENSOR * s)
        sensors_agree = _is_any_used(u, k)
        for i in range(s):
            if _test_sensor(state, u, k, i, trust, scores):
                failing, sensors_agree = True, False
        for i in range(state.motion.shape[0]):
            test, step = OF_SENSOR * s + OF_HEAT * m_e + 1 + i, u.motion[k, OF_NUT * i : OF_NUT * (i + 1)]
            score = (
                0.0
                if isnan(step[RATIO])
                else max(step[RATIO] / DISAGREE, FALLS_SHORT / max(step[RATIO], 1e-9))
            )
            _note(state, test, score, u.time_s[k], step[RATIO], 1.0)
            failing = failing or _fails(state, test)
            test += state.motion.shape[0]
            stands = jump_stands(state.motion[i], step, u.dt_s[k], sensors_agree)
            _note(state, test, 2.0 if stands else 0.0, u.time_s[k], step[JUMP], state.motion[i, USUAL_S])
            failing = failing or _fails(state, test)
        if failing:
            quality[k] = max(quality[k], ESTIMATE_DEGRADED)
            for part in range(part_quality.shape[1]):
                part_quality[k, part] = max(part_quality[k, part], ESTIMATE_DEGRADED)
        elif starting:
            part_quality[k, HEAT] = max(part_quality[k, HEAT], ESTIMATE_STARTING)
