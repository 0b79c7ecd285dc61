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
from observer.kernels.libc import INFINITY, NAN, cython, exp, isfinite, isnan, sqrt

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
KNOWN_SHARE = 0.6  # part of its prior below which a σ must be for a heat, the field or the error to be known
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

OF_SENSOR, OF_HEAT = 4, 2
"""How many tests a sensor and a heat have."""


def compare_ways(path, travel_m, memory, motion, degraded):
    """Fill in the motion of the nut in each of K steps from its samples; `memory` (1,) is updated.

    If distance and speed disagree, and for a time after a jump, the nut's position is lost.
    """
    nut, stroke_m = cython.address(memory[0]), travel_m[1] - travel_m[0]
    for k in range(len(motion)):
        motion[k].travels, held_s, began_s = 0.0, nut.later_s, nut.time_s
        for i in range(path.offset[k], path.offset[k + 1]):
            since_s, way_m = path.time_s[i] - nut.time_s, path.position_m[i] - nut.place_m
            allowed_m = 0.5 * (path.driven_m_s[i] + nut.speed_m_s) * since_s
            jumped = False
            if since_s > 0.0 and isfinite(way_m):
                jumped = _look_for_jump(nut, path.time_s[i], way_m, path.driven_m_s[i], path.speed_age_s[i])
            if jumped:
                nut.made_m, nut.allowed_m = 0.0, 0.0
                nut.open_m2, nut.open_m = 0.0, 0.0
            elif 0.0 < since_s < 10.0 and 2.5 * allowed_m <= stroke_m and nut.late_s <= _STOPPED_S:
                motion[k].travels += abs(way_m) / stroke_m
                fade = exp(-since_s / _MOTION_S)
                nut.made_m = fade * nut.made_m + abs(way_m)
                nut.allowed_m = fade * nut.allowed_m + allowed_m
                open_m = longest_way(nut.speed_m_s, path.driven_m_s[i], 0.0, since_s) - allowed_m
                nut.open_m2 = squared(fade) * nut.open_m2 + squared(open_m)
                nut.open_m = fade * nut.open_m + open_m
            nut.time_s, nut.place_m = path.time_s[i], path.position_m[i]
            nut.speed_m_s, nut.speed_age_s = path.driven_m_s[i], path.speed_age_s[i]
            _compare_with_travel(nut, travel_m)
        # what arrives at once was held together, so only the time between steps takes lateness away
        if nut.later_s == held_s and nut.time_s > began_s:
            nut.later_s = max(held_s - (nut.time_s - began_s), 0.0)
        motion[k].ratio = NAN
        # polls in step with a motion to and fro miss all of its speed: a long way is judged by the most
        farther_m = nut.made_m - nut.allowed_m - nut.open_m
        shorter_m = nut.allowed_m - nut.made_m - _UNEXPLAINED * sqrt(nut.open_m2)
        if max(nut.made_m, nut.allowed_m) >= _MOTION_ENOUGH * stroke_m and (
            farther_m > 0.0 or shorter_m > 0.0
        ):
            motion[k].ratio = nut.made_m / max(nut.allowed_m, 1e-6 * stroke_m)
        motion[k].jump_m = nut.jump_m
        if motion[k].ratio > DISAGREE or motion[k].ratio < FALLS_SHORT:
            nut.disagreed = 1.0
            degraded[k] = NUT_LOST
        open_s = _OPEN_S * min(1.0, abs(nut.jump_m) / stroke_m)
        if nut.jump_m != 0.0 and nut.time_s - nut.jumped_s <= open_s:
            degraded[k] = NUT_LOST


def longest_way(before_m_s, after_m_s, unsure_m_s, elapsed_s):
    """Return the longest distance in m that a nut can travel in a time between two speeds.

    It accelerates and brakes with the greatest acceleration a. The distance exceeds that of the mean speed by
    (a T² - Δv²/a)/4. The true speeds differ from the readings by up to `unsure_m_s`.
    """
    change_m_s = max(abs(after_m_s - before_m_s) - 2.0 * unsure_m_s, 0.0)
    gained_m = (
        squared(elapsed_s) * GREATEST_ACCELERATION_m_s2 - squared(change_m_s) / GREATEST_ACCELERATION_m_s2
    )
    way_m = (0.5 * (before_m_s + after_m_s) + unsure_m_s) * elapsed_s + 0.25 * max(gained_m, 0.0)
    return min(way_m, max(GREATEST_SPEED_m_s, before_m_s, after_m_s) * elapsed_s)


def _look_for_jump(nut, time_s, way_m, driven_m_s, speed_age_s):
    """Add a way that no motion explains to the jumps, and return whether there was one.

    A jump back to where the nut was ends them, as does any after way and speed have disagreed.
    """
    since_s, before_m_s = time_s - nut.time_s, nut.speed_m_s
    late_s = max(nut.later_s, nut.usual_s - since_s)
    repeats_s = nut.repeats_s if nut.repeats_m > ROUNDED_m else 0.0
    elapsed_s = since_s + max(late_s, repeats_s, nut.refresh_s)
    unsure_m_s = GREATEST_ACCELERATION_m_s2 * (SKEW_S + max(speed_age_s, nut.speed_age_s))
    allowed_m = longest_way(before_m_s, driven_m_s, unsure_m_s, elapsed_s)
    allowed_m += ROUNDED_m + _WAY_SHARE * max(before_m_s, driven_m_s) * elapsed_s
    _time_the_poll(nut, since_s, way_m, min(before_m_s, driven_m_s))
    if isnan(allowed_m) or nut.samples < _SAMPLES_FIRST or abs(way_m) <= allowed_m:
        return False
    mean_m = 0.5 * (before_m_s + driven_m_s) * since_s
    jump_m = nut.jump_m + way_m - (mean_m if way_m > 0.0 else -mean_m)
    if nut.disagreed != 0.0 or abs(jump_m) <= allowed_m:
        jump_m = 0.0
    nut.jump_m, nut.jumped_s, nut.disagreed = jump_m, time_s, 0.0
    return True


def _time_the_poll(nut, since_s, way_m, driven_m_s):
    """Take in when a sample came: the usual time between samples, lateness, refresh of the register."""
    if nut.samples == 0.0:
        nut.usual_s = since_s
    longer_s = since_s - nut.usual_s
    nut.late_s = max(exp(-since_s / _LATENESS_FADES_S) * nut.late_s + longer_s, 0.0)
    if longer_s > _UNUSUAL * nut.usual_s:  # a server that catches up after a pause reads old places
        nut.later_s = max(nut.later_s, nut.late_s)
    most_s = _UNUSUAL * nut.usual_s if nut.samples >= _SAMPLES_FIRST else since_s
    nut.usual_s += min(max(longer_s, -most_s), most_s) / min(nut.samples + 1.0, 64.0)
    if driven_m_s > 0.0:
        nut.samples += 1.0
    if way_m == 0.0 and driven_m_s > 0.0:
        nut.repeats_s += since_s
        nut.repeats_m += driven_m_s * since_s
        return
    if nut.repeats_s <= _LONGEST_REFRESH_S and nut.repeats_m > ROUNDED_m:
        nut.refresh_s = max(nut.refresh_s, nut.repeats_s)
    nut.repeats_s, nut.repeats_m = 0.0, 0.0


def _compare_with_travel(nut, travel_m):
    """Take a jump back if it would place the nut beyond the ends of its travel: then it was motion."""
    place_m, jump_m = nut.place_m, nut.jump_m
    if jump_m == 0.0:
        nut.lowest_m = min(nut.lowest_m, place_m, travel_m[0])
        nut.highest_m = max(nut.highest_m, place_m, travel_m[1])
        return
    beyond_m = max(nut.lowest_m - (place_m - jump_m), (place_m - jump_m) - nut.highest_m)
    if beyond_m > 0.5 * abs(jump_m):
        nut.jump_m = 0.0


def jump_stands(nut, step, dt_s, agree):
    """Return whether a nut's jump is still to be reported.

    Temperatures confirm the position if they have agreed with the model since the jump, for long enough while
    the nut moved. If they have disagreed once since, they can do so no more: the heats may have adapted.
    """
    if step.jump_m != nut.judged_m:
        nut.judged_m, nut.agreed_s, nut.agreed_travels = step.jump_m, 0.0, 0.0
    confirmed = nut.agreed_s >= _AGREE_S and nut.agreed_travels >= _AGREE_TRAVELS
    if step.jump_m != 0.0 and not confirmed:
        nut.agreed_s = nut.agreed_s + dt_s if agree else -INFINITY
        nut.agreed_travels += step.travels
    return step.jump_m != 0.0 and not confirmed


def _note(state, test, score, time_s, value, expected):
    """Update a test by its score: it fails from 1 on, and passes again below `_CLEAR`."""
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
    before, since_s = state.last[i].nu, time_s - state.last[i].time_s
    state.last[i].nu, state.last[i].time_s = nu, time_s
    if not since_s > 0.0:
        return
    for w in range(2):
        window, share = cython.address(state.sensor[i, w]), 1.0 - exp(-since_s / WINDOWS_S[w])
        window.mean += share * (nu - window.mean)
        window.product += share * (nu * before - window.product)
        window.square += share * (nu * nu - window.square)
        window.variance = squared(1.0 - share) * window.variance + share * share
        window.lasting += share * (lasting - window.lasting)


def _scores(state, i, scores):
    """Write the scores of sensor i: bias, colour, noise; a clean minute resets the longer window.

    The share ρ = 1 - R/S of an innovation's variance S lasts from sample to sample; R is the reading's noise.
    With tolerances considered, the limits of bias and colour are wider by 2 √ρ and 4 ρ.
    """
    for q in range(3):
        scores[q] = 0.0
    for w in range(2):
        window = cython.address(state.sensor[i, w])
        sure = 1.0 / (_SURE_SE * sqrt(max(window.variance, 1e-300)))
        lasting = _LASTING * sqrt(window.lasting)
        scores[0] = max(scores[0], min(abs(window.mean) * sure, abs(window.mean) / (_BIAS[w] + lasting)))
        colour = min(window.product * sure, window.product / (_COLOUR[w] + lasting * lasting))
        scores[1] = max(scores[1], colour)
        noise = window.square - 1.0
        scores[2] = max(scores[2], min(noise * sure / sqrt(2.0), noise / _NOISE))
    minute, longer = cython.address(state.sensor[i, 0]), cython.address(state.sensor[i, 1])
    lasting = _LASTING * sqrt(minute.lasting)
    clean = abs(minute.mean) < _CLEAN * (_BIAS[0] + lasting)
    clean = clean and minute.product < _CLEAN * (_COLOUR[0] + lasting * lasting)
    clean = clean and minute.square < 1.0 + _CLEAN * _NOISE
    if clean and max(scores[0], scores[1], scores[2]) >= 1.0:
        longer.mean, longer.product, longer.square = minute.mean, minute.product, minute.square


def forget_window(window):
    """Reset the means of a window."""
    window.mean, window.product, window.square, window.variance, window.lasting = 0.0, 0.0, 0.0, 0.0, 0.0


def _off_law(state, row, distance, dt_s, limit, slack):
    """Average the distance of a heat from its law; return the score. Limits are `slack` times as wide."""
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
    """Return whether sensor i arrived good and was rejected by the gate."""
    return u.input_quality[k, i] == GOOD and u.sensor_quality[k, i] == REJECTED


def _forget_after_refusals(state, u, k):
    """Reset the means when no sensor is rejected any longer, because the state has changed since."""
    refused = 0.0
    for i in range(u.nu.shape[1]):
        if _is_refused(u, k, i):
            refused = 1.0
    if refused == 0.0 and state.refused[0] > 0.0:
        for i in range(state.sensor.shape[0]):
            for w in range(2):
                forget_window(cython.address(state.sensor[i, w]))
        for i in range(state.heat.shape[0]):
            for w in range(2):
                state.heat[i, w] = 0.0
    state.refused[0] = refused


def _test_sensor(state, u, k, i, trust, scores):
    """Test sensor i; return whether a test fails. Excluded sensors are not tested."""
    refused, test = _is_refused(u, k, i), OF_SENSOR * i
    if u.sensor_quality[k, i] == EXCLUDED:
        for j in range(OF_SENSOR):
            state.since_s[test + j] = NAN
        for w in range(2):
            forget_window(cython.address(state.sensor[i, w]))
        return False
    has_value = isfinite(u.nu[k, i])
    if has_value and not refused:
        nu = min(max(u.nu[k, i] / u.nu_sigma[k, i], -_CLIP), _CLIP)
        lasting = max(0.0, 1.0 - squared(trust.noise_K[i] / u.nu_sigma[k, i]))
        _average_innovation(state, i, nu, lasting, u.time_s[k])
    _scores(state, i, scores)
    last, long = state.sensor[i, 0].mean, state.sensor[i, 1].mean
    mean = long if abs(long) / _BIAS[1] > abs(last) / _BIAS[0] else last
    product = max(state.sensor[i, 0].product, state.sensor[i, 1].product)
    square = max(state.sensor[i, 0].square, state.sensor[i, 1].square)
    _note(state, test, scores[0], u.time_s[k], mean, 0.0)
    _note(state, test + 1, scores[1], u.time_s[k], product, 0.0)
    _note(state, test + 2, scores[2], u.time_s[k], sqrt(max(square, 0.0)), 1.0)
    if has_value or not refused:
        _note(state, test + 3, 2.0 if refused else 0.0, u.time_s[k], u.nu[k, i], u.nu_sigma[k, i])
    failing = False
    for j in range(OF_SENSOR):
        failing = failing or _fails(state, test + j)
    return failing


def _distance(state, u, k, j, uncertainty):
    """Return the distance of heat j from its law, relative to their joint uncertainty."""
    law_W = u.law_W[k, j]
    state.peak_W[j] = max(state.peak_W[j] * exp(-u.dt_s[k] / _PEAK_S), abs(law_W))
    trusted_W, floor_W = uncertainty * abs(law_W), _LEAST_W + _FLOOR * state.peak_W[j]
    return (u.heat_W[k, j] - law_W) / sqrt(
        squared(u.heat_sigma_W[k, j]) + squared(trusted_W) + squared(floor_W)
    )


def _test_heats(state, u, k, trust, base):
    """Test every heat and all of them together; return whether one fails, and whether one is unknown."""
    m_e, total, laws, failing, starting = u.heat_W.shape[1], 0.0, 0, False, False
    for j in range(m_e):
        sigma_W, test = u.heat_sigma_W[k, j], base + OF_HEAT * j
        needed_W = KNOWN_SHARE * trust.initial_W[j]
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
            test, step = OF_SENSOR * s + OF_HEAT * m_e + 1 + i, cython.address(u.motion[k, i])
            score = (
                0.0 if isnan(step.ratio) else max(step.ratio / DISAGREE, FALLS_SHORT / max(step.ratio, 1e-9))
            )
            _note(state, test, score, u.time_s[k], step.ratio, 1.0)
            failing = failing or _fails(state, test)
            test += state.motion.shape[0]
            jump_remains = jump_stands(cython.address(state.motion[i]), step, u.dt_s[k], sensors_agree)
            _note(
                state, test, 2.0 if jump_remains else 0.0, u.time_s[k], step.jump_m, state.motion[i].usual_s
            )
            failing = failing or _fails(state, test)
        if failing:
            quality[k] = max(quality[k], ESTIMATE_DEGRADED)
            for part in range(part_quality.shape[1]):
                part_quality[k, part] = max(part_quality[k, part], ESTIMATE_DEGRADED)
        elif starting:
            part_quality[k, HEAT] = max(part_quality[k, HEAT], ESTIMATE_STARTING)
