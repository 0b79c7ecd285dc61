"""The path of a nut, sample by sample: how far it ran since the last one, and where it turned.

See `observer.model.rod.moving`. `scalars` (26,) are what is remembered, under the indices below.
"""

from __future__ import annotations

from observer.kernels.arithmetic import remainder, sign
from observer.kernels.libm import NAN, floor, fmod, isnan, lrint

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


# What is remembered, by index.
_AT, _HERE, _VELOCITY, _SPEED, _LOW, _HIGH, _DRIVEN, _SENSE, _FAR, _COUNT, _MADE = (
    0,
    1,
    2,
    3,
    4,
    5,
    6,
    7,
    8,
    9,
    10,
)


def follow_path(scalars, sample_s, sample_m, offset, driven_m_s, stroke_m, ends_m):
    """Take in the samples of K steps; `ends_m` (K, 2) are then where the nut turned last after each."""
    for k in range(len(ends_m)):
        for i in range(offset[k], offset[k + 1]):
            take_sample(scalars, sample_s[i], sample_m[i], driven_m_s[i], stroke_m)
        ends_m[k, 0], ends_m[k, 1] = scalars[_LOW], scalars[_HIGH]


def take_sample(scalars, at_s, there_m, driven_m_s, stroke_m):
    """Take in a sample; `driven_m_s` is speed times lead at it, NaN where unknown. Return where the nut
    turned on its way to it: the sample itself if it came straight, NaN if that cannot be told.
    """
    since_s, here_m, before = at_s - scalars[_AT], scalars[_HERE], scalars[_VELOCITY]
    turn_m = NAN
    if since_s > 0.0:
        made_m_s = abs(there_m - here_m) / since_s
        lately_m_s = _remember(scalars, made_m_s, since_s)
        speed_m_s = _mean_driven(scalars[_DRIVEN], driven_m_s)
        known = not isnan(speed_m_s)
        told = (
            speed_m_s if known else max(lately_m_s, made_m_s)
        ) * since_s * SAMPLES_PER_TRAVERSE <= stroke_m
        if not known or (told and scalars[_COUNT] >= RECENT and lately_m_s < BELIEVED * speed_m_s):
            speed_m_s = lately_m_s
        if told:
            scalars[_SPEED] = speed_m_s
            turn_m = _turn(scalars, there_m, speed_m_s * since_s, stroke_m)
            _come(scalars, turn_m, stroke_m)
            _come(scalars, there_m, stroke_m)
        elif since_s < FORGOTTEN_S and before != 0.0 and scalars[_LOW] < scalars[_HIGH]:
            if known:
                scalars[_SPEED] = speed_m_s
            run_m = sign(before) * scalars[_SPEED] * since_s
            _, sense = on_the_way(here_m, run_m, scalars[_LOW], scalars[_HIGH])
            scalars[_VELOCITY] = sense * sign(before) * scalars[_SPEED]
            scalars[_SENSE], scalars[_FAR] = sense * sign(before), there_m
        else:
            scalars[_VELOCITY], scalars[_SPEED] = 0.0, speed_m_s
            scalars[_SENSE], scalars[_FAR] = 0.0, there_m
    elif not isnan(since_s):
        turn_m = there_m  # the same moment again: it is there, and that took no time
    scalars[_AT], scalars[_HERE], scalars[_DRIVEN] = at_s, there_m, driven_m_s
    return turn_m


def _mean_driven(first_m_s, last_m_s):
    """The mean of speed times lead over a step, by what is known of it at both ends."""
    if isnan(first_m_s):
        return last_m_s
    return first_m_s if isnan(last_m_s) else 0.5 * (first_m_s + last_m_s)


def _remember(scalars, made_m_s, since_s):
    """Remember the speed of a step that was long enough to show it; return what counts as full speed."""
    if since_s >= BRIEF_S:
        scalars[_MADE + lrint(fmod(scalars[_COUNT], RECENT))] = made_m_s
        scalars[_COUNT] += 1.0
    known = min(lrint(scalars[_COUNT]), RECENT)
    if known == 0:
        return 0.0
    rank = min(RANK, 1 + known // 4)
    for i in range(known):
        faster, as_fast, own = 0, 0, scalars[_MADE + i]
        for j in range(known):
            faster += 1 if scalars[_MADE + j] > own else 0
            as_fast += 1 if scalars[_MADE + j] == own else 0
        if faster < rank <= faster + as_fast:
            return own
    return 0.0


def _turn(scalars, there_m, run_m, stroke_m):
    """Where the nut turned since the last sample, given how far it ran; the new place, if it did not."""
    here_m, before, speed_m_s = scalars[_HERE], scalars[_VELOCITY], scalars[_SPEED]
    made_m = there_m - here_m
    full = abs(made_m) >= FULL * run_m and made_m != 0.0
    fine = run_m * FINE <= stroke_m
    if full or fine or before == 0.0:
        if full or (fine and made_m * before < 0.0):
            scalars[_VELOCITY] = sign(made_m) * speed_m_s
        elif not fine:
            scalars[_VELOCITY] = 0.0
        return there_m
    scalars[_VELOCITY] = -sign(before) * speed_m_s  # it runs back
    return here_m + 0.5 * (sign(before) * run_m + made_m)


def _come(scalars, place_m, stroke_m):
    """Note that the nut came to a place: where it has come back far enough, the farthest was an end."""
    back_m = scalars[_FAR] - place_m
    onward = scalars[_SENSE] != 0.0 and scalars[_SENSE] * back_m <= 0.0
    if onward or isnan(back_m):
        scalars[_FAR] = place_m
    elif abs(back_m) >= TURNED * stroke_m:
        if scalars[_SENSE] > 0.0:
            scalars[_HIGH] = scalars[_FAR]
        elif scalars[_SENSE] < 0.0:
            scalars[_LOW] = scalars[_FAR]
        scalars[_SENSE], scalars[_FAR] = -sign(back_m), place_m


def on_the_way(here_m, run_m, low_m, high_m):
    """Where a nut comes that runs so far to and fro, and whether it then runs as at first, 1, or back, −1."""
    length_m = high_m - low_m
    along = remainder(here_m + run_m - low_m, 2.0 * length_m)
    back = along > length_m
    turned = remainder(floor((here_m + run_m - low_m) / length_m), 2.0) != 0.0
    return low_m + (2.0 * length_m - along if back else along), -1.0 if turned else 1.0
