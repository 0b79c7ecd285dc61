"""The path of a nut, sample by sample, and its columns averaged over the path inside a step.

See `observer.model.rod.moving`.
"""

from __future__ import annotations

from observer.kernels.libc import NAN, cos, cython, exp, floor, fmod, isnan, lrint, sin

MEMORY_S = 10.0
"""Time constant of what is remembered of a nut's footprint."""
SAMPLES_PER_TRAVERSE = 2.5
"""With fewer, some traverses show the full speed once or never; seen on an independent screw."""
FORGOTTEN_S = 3600.0
"""After so long nobody knows what a nut is at."""
FULL = 0.95
"""Part of the way it ran below which a step holds a reversal."""
FINE = 50.0
"""With so many samples a traverse a reversal cut off by a line is no more than a hundredth of the stroke."""
TURNED = 0.02
"""Part of the stroke by which a nut must have come back before the place it came back from is an end."""
BRIEF_S = 0.01
"""Samples closer than this show when they were delivered, not how fast the nut is."""
RECENT = 16
"""Steps whose speeds are remembered …"""
RANK = 4
"""… and which of them, from the fastest, counts as full speed: steps that hold a reversal are slower, late
frames faster, and neither are as many."""
BELIEVED = 0.7
"""Part of speed times lead that lately must have been made, or the lead is not that of this nut."""


def follow_path(memory, path, stroke_m, ends_m):
    """Take in the samples of K steps; `ends_m` (K, 2) are then where the nut turned last after each, and
    `memory` (1,) is updated.
    """
    nut = cython.address(memory[0])
    for k in range(len(ends_m)):
        for i in range(path.offset[k], path.offset[k + 1]):
            take_sample(nut, path.time_s[i], path.position_m[i], path.driven_m_s[i], stroke_m)
        ends_m[k, 0], ends_m[k, 1] = nut.low_m, nut.high_m


def take_sample(nut, at_s, there_m, driven_m_s, stroke_m):
    """Take in a sample; `driven_m_s` is speed times lead at it, NaN where unknown. Return where the nut
    turned on its way to it: the sample itself if it came straight, NaN if that is unknown.
    """
    since_s, here_m, before = at_s - nut.time_s, nut.here_m, nut.velocity_m_s
    turn_m = NAN
    if since_s > 0.0:
        made_m_s = abs(there_m - here_m) / since_s
        lately_m_s = _remember(nut, made_m_s, since_s)
        speed_m_s = _mean_driven(nut.driven_m_s, driven_m_s)
        has_speed = not isnan(speed_m_s)
        resolved = (
            speed_m_s if has_speed else max(lately_m_s, made_m_s)
        ) * since_s * SAMPLES_PER_TRAVERSE <= stroke_m
        if not has_speed or (resolved and nut.count >= RECENT and lately_m_s < BELIEVED * speed_m_s):
            speed_m_s = lately_m_s
        if resolved:
            nut.speed_m_s = speed_m_s
            turn_m = _turn(nut, there_m, speed_m_s * since_s, stroke_m)
            _come(nut, turn_m, stroke_m)
            _come(nut, there_m, stroke_m)
        elif since_s < FORGOTTEN_S and before != 0.0 and nut.low_m < nut.high_m:
            if has_speed:
                nut.speed_m_s = speed_m_s
            run_m = sign(before) * nut.speed_m_s * since_s
            _, sense = on_the_way(here_m, run_m, nut.low_m, nut.high_m)
            nut.velocity_m_s = sense * sign(before) * nut.speed_m_s
            nut.sense, nut.far_m = sense * sign(before), there_m
        else:
            nut.velocity_m_s, nut.speed_m_s = 0.0, speed_m_s
            nut.sense, nut.far_m = 0.0, there_m
    elif not isnan(since_s):
        turn_m = there_m  # the same moment again: it is there, and that took no time
    nut.time_s, nut.here_m, nut.driven_m_s = at_s, there_m, driven_m_s
    return turn_m


def _mean_driven(first_m_s, last_m_s):
    """Return the mean of speed times lead over a step, from its known values at both ends."""
    if isnan(first_m_s):
        return last_m_s
    return first_m_s if isnan(last_m_s) else 0.5 * (first_m_s + last_m_s)


def _remember(nut, made_m_s, since_s):
    """Remember the speed of a step that was long enough to show it; return what counts as full speed."""
    if since_s >= BRIEF_S:
        nut.recent_m_s[lrint(fmod(nut.count, RECENT))] = made_m_s
        nut.count += 1.0
    count = min(lrint(nut.count), RECENT)
    if count == 0:
        return 0.0
    rank = min(RANK, 1 + count // 4)
    for i in range(count):
        faster, as_fast, speed_m_s = 0, 0, nut.recent_m_s[i]
        for j in range(count):
            faster += 1 if nut.recent_m_s[j] > speed_m_s else 0
            as_fast += 1 if nut.recent_m_s[j] == speed_m_s else 0
        if faster < rank <= faster + as_fast:
            return speed_m_s
    return 0.0


def _turn(nut, there_m, run_m, stroke_m):
    """Where the nut turned since the last sample, given how far it ran; the new place, if it did not."""
    here_m, before, speed_m_s = nut.here_m, nut.velocity_m_s, nut.speed_m_s
    made_m = there_m - here_m
    full = abs(made_m) >= FULL * run_m and made_m != 0.0
    fine = run_m * FINE <= stroke_m
    if full or fine or before == 0.0:
        if full or (fine and made_m * before < 0.0):
            nut.velocity_m_s = sign(made_m) * speed_m_s
        elif not fine:
            nut.velocity_m_s = 0.0
        return there_m
    nut.velocity_m_s = -sign(before) * speed_m_s  # it runs back
    return here_m + 0.5 * (sign(before) * run_m + made_m)


def _come(nut, place_m, stroke_m):
    """Note that the nut came to a place: where it has come back far enough, the farthest was an end."""
    back_m = nut.far_m - place_m
    onward = nut.sense != 0.0 and nut.sense * back_m <= 0.0
    if onward or isnan(back_m):
        nut.far_m = place_m
    elif abs(back_m) >= TURNED * stroke_m:
        if nut.sense > 0.0:
            nut.high_m = nut.far_m
        elif nut.sense < 0.0:
            nut.low_m = nut.far_m
        nut.sense, nut.far_m = -sign(back_m), place_m


def on_the_way(here_m, run_m, low_m, high_m):
    """Where a nut comes that runs so far to and fro, and whether it then runs as at first, 1, or back, −1."""
    length_m = high_m - low_m
    along = remainder(here_m + run_m - low_m, 2.0 * length_m)
    back = along > length_m
    turned = remainder(floor((here_m + run_m - low_m) / length_m), 2.0) != 0.0
    return low_m + (2.0 * length_m - along if back else along), -1.0 if turned else 1.0


def average_columns(nut, desk, dt_s, path):
    """Advance the averaged columns B, C of a nut through K steps; `step_B`, `step_C` are scratch."""
    weight_s, B, C, sum_B, sum_C = desk.weight_s, desk.B, desk.C, desk.sum_B, desk.sum_C
    memory = cython.address(desk.path[0])
    step_B, step_C, turn, stroke_m = desk.step_B, desk.step_C, nut.turn, nut.stroke_m
    for k in range(len(dt_s)):
        for n in range(len(step_B)):
            step_B[n] = 0.0
        for r in range(len(step_C)):
            step_C[r] = 0.0
        weight, gap_s, located = 0.0, 0.0, True
        for i in range(path.offset[k], path.offset[k + 1]):
            here_m, there_m, since_s = memory.here_m, path.position_m[i], path.time_s[i] - memory.time_s
            before, low_m, high_m = memory.velocity_m_s, memory.low_m, memory.high_m
            turn_m = take_sample(memory, path.time_s[i], there_m, path.driven_m_s[i], stroke_m)
            runs_on = isnan(turn_m) and since_s > 0.0 and before != 0.0 and memory.low_m < memory.high_m
            run_m = sign(before) * memory.speed_m_s * since_s
            if abs(run_m) > 4 * stroke_m:  # it has been everywhere equally long
                run_m = 2 * (high_m - low_m)
            if isnan(turn_m) and not runs_on:
                located, here_m, turn_m = False, there_m, there_m
                gap_s = max(gap_s, since_s)
            share = max(since_s, 1e-6) if since_s > 0.0 else 1e-6
            weight += share
            out_m, back_m = abs(turn_m - here_m), abs(there_m - turn_m)
            length_m = abs(run_m) if runs_on else out_m + back_m
            points = 1 + lrint(floor(length_m / (nut.nut_m / 4)))
            for j in range(points):
                part = (j + 0.5) / points
                if runs_on:
                    centre, _ = on_the_way(here_m, run_m * part, low_m, high_m)
                elif part * length_m <= out_m:
                    centre = here_m + part * length_m * sign(turn_m - here_m)
                else:
                    centre = turn_m + (part * length_m - out_m) * sign(there_m - turn_m)
                add_columns(step_B, step_C, share / points, centre, nut)
        if weight > 0.0:
            share = max(min(dt_s[k], MEMORY_S / 4), 1e-6)  # a longer step says where the nut is after it only
            fade = exp(-share / MEMORY_S)
            weight_s[0] = fade * weight_s[0] + share
            # What the dropped modes hold follows the nut as fast as they settle, not at once.
            settle = 1.0 - exp(-dt_s[k] * nut.lag_decay_1_s)
            spread = gap_s > MEMORY_S
            for n in range(len(nut.mu_1_m)):
                sum_B[n] = fade * sum_B[n] + share * step_B[n] / weight
                B[n] = step_B[n] / weight if located else nut.mean_B[n] if spread else sum_B[n] / weight_s[0]
            for r in range(len(C)):
                sum_C[r] = fade * sum_C[r] + share * step_C[r] / weight
                column = (
                    step_C[r] / weight if located else nut.mean_C[r] if spread else sum_C[r] / weight_s[0]
                )
                C[r] += settle * (column - C[r])
        B[nut.lag] = nut.lag_decay_1_s
        for n in range(desk.out_B.shape[1]):
            desk.out_B[k, n] = B[n]
            if len(turn) > 0:
                desk.out_B[k, n] = 0.0
                for i in range(len(B)):
                    desk.out_B[k, n] += turn[n, i] * B[i]
        for r in range(len(C)):
            desk.out_C[k, r] = C[r]


def add_columns(B, C, share, centre_m, nut):
    """Add `share` of the columns with the nut at one place; without phases the modes are plain waves."""
    mu, phase, scale, table_C = nut.mu_1_m, nut.phase, nut.scale, nut.table_C
    centre = min(max(centre_m, 0.0), nut.screw_m)
    a, b = max(centre - nut.nut_m / 2, 0.0), min(centre + nut.nut_m / 2, nut.screw_m)
    middle, half = (a + b) / 2, (b - a) / 2
    if len(phase) == 0 and len(mu) > 0:
        add_waves(B, share, middle - nut.screw_m / 2, half, mu)
    for n in range(len(phase)):
        reach = mu[n] * half
        mean = sin(reach) / reach if reach > 1e-8 else 1.0
        B[n] += share * scale[n] * cos(mu[n] * middle - phase[n]) * mean / nut.conductance_W_m
    place = centre / nut.screw_m * (len(table_C) - 1)
    low = min(lrint(floor(place)), len(table_C) - 2)
    right = place - low
    for r in range(len(C)):
        C[r] += share * ((1.0 - right) * table_C[low, r] + right * table_C[low + 1, r])


def add_waves(B, share, x, half, mu):
    """Add `share` of the means over x ± half of cos(μ x), and after them of sin(μ x).

    The μ are evenly spaced from 0, so each term follows from the one before it by a rotation.
    """
    G = len(mu) // 2
    cos_x, sin_x, cos_half, sin_half = cos(mu[1] * x), sin(mu[1] * x), cos(mu[1] * half), sin(mu[1] * half)
    c, s, h, r = 1.0, 0.0, 1.0, 0.0
    for n in range(G):
        reach = mu[n] * half
        mean = share * r / reach if reach > 1e-8 else share
        B[n] += c * mean
        B[G + n] += s * mean
        c, s = c * cos_x - s * sin_x, s * cos_x + c * sin_x
        h, r = h * cos_half - r * sin_half, r * cos_half + h * sin_half


def sign(value):
    """−1, 0 or 1."""
    return 1.0 if value > 0.0 else -1.0 if value < 0.0 else value


def remainder(value, period):
    """Return the remainder of a value after whole periods, from 0 up to one period."""
    left = fmod(value, period)
    return left + period if left < 0.0 else left
