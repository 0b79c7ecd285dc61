"""The columns of a nut that moves, averaged over its path inside a step (see `observer.model.rod.moving`)."""

from __future__ import annotations

from observer.kernels.arithmetic import sign
from observer.kernels.libm import cos, exp, floor, isnan, lrint, sin
from observer.kernels.path import MEMORY_S, on_the_way, take_sample


def average_columns(
    scalars, weight_s, B, C, sum_B, sum_C, dt_s, sample_s, sample_m, offset, driven_m_s, out_B, out_C,
    mu, phase, scale, kA, nut_m, screw_m, stroke_m, lag, lag_decay, table_C, mean_B, mean_C, turn, step_B,
    step_C,
):  # fmt: skip
    """Advance the averaged columns B, C through K steps; `scalars` are those of `PathState`, in its order;
    `step_B`, `step_C` are scratch.
    """
    for k in range(len(dt_s)):
        for n in range(len(step_B)):
            step_B[n] = 0.0
        for r in range(len(step_C)):
            step_C[r] = 0.0
        weight, gap_s, told = 0.0, 0.0, True
        for i in range(offset[k], offset[k + 1]):
            here_m, there_m, since_s = scalars[1], sample_m[i], sample_s[i] - scalars[0]
            before, low_m, high_m = scalars[2], scalars[4], scalars[5]
            turn_m = take_sample(scalars, sample_s[i], there_m, driven_m_s[i], stroke_m)
            runs_on = isnan(turn_m) and since_s > 0.0 and before != 0.0 and scalars[4] < scalars[5]
            run_m = sign(before) * scalars[3] * since_s
            if abs(run_m) > 4 * stroke_m:  # it has been everywhere equally long
                run_m = 2 * (high_m - low_m)
            if isnan(turn_m) and not runs_on:
                told, here_m, turn_m = False, there_m, there_m
                gap_s = max(gap_s, since_s)
            share = max(since_s, 1e-6) if since_s > 0.0 else 1e-6
            weight += share
            out_m, back_m = abs(turn_m - here_m), abs(there_m - turn_m)
            length_m = abs(run_m) if runs_on else out_m + back_m
            points = 1 + lrint(floor(length_m / (nut_m / 4)))
            for j in range(points):
                part = (j + 0.5) / points
                if runs_on:
                    centre, _ = on_the_way(here_m, run_m * part, low_m, high_m)
                elif part * length_m <= out_m:
                    centre = here_m + part * length_m * sign(turn_m - here_m)
                else:
                    centre = turn_m + (part * length_m - out_m) * sign(there_m - turn_m)
                add_columns(
                    step_B, step_C, share / points, centre, mu, phase, scale, kA, nut_m, screw_m, table_C
                )
        if weight > 0.0:
            share = max(min(dt_s[k], MEMORY_S / 4), 1e-6)  # a longer step says where the nut is after it only
            fade = exp(-share / MEMORY_S)
            weight_s[0] = fade * weight_s[0] + share
            # What the dropped modes hold follows the nut as fast as they settle, not at once.
            settle = 1.0 - exp(-dt_s[k] * lag_decay)
            spread = gap_s > MEMORY_S
            for n in range(len(mu)):
                sum_B[n] = fade * sum_B[n] + share * step_B[n] / weight
                B[n] = step_B[n] / weight if told else mean_B[n] if spread else sum_B[n] / weight_s[0]
            for r in range(len(C)):
                sum_C[r] = fade * sum_C[r] + share * step_C[r] / weight
                seen = step_C[r] / weight if told else mean_C[r] if spread else sum_C[r] / weight_s[0]
                C[r] += settle * (seen - C[r])
        B[lag] = lag_decay
        for n in range(len(B)):
            out_B[k, n] = B[n]
            if len(turn) > 0:
                out_B[k, n] = 0.0
                for i in range(len(B)):
                    out_B[k, n] += turn[n, i] * B[i]
        for r in range(len(C)):
            out_C[k, r] = C[r]


def add_columns(B, C, share, centre_m, mu, phase, scale, kA, nut_m, screw_m, table_C):
    """Add `share` of the columns with the nut at one place; without phases the modes are plain waves."""
    centre = min(max(centre_m, 0.0), screw_m)
    a, b = max(centre - nut_m / 2, 0.0), min(centre + nut_m / 2, screw_m)
    middle, half = (a + b) / 2, (b - a) / 2
    if len(phase) == 0:
        add_waves(B, share, middle - screw_m / 2, half, mu)
    for n in range(len(phase)):
        reach = mu[n] * half
        mean = sin(reach) / reach if reach > 1e-8 else 1.0
        B[n] += share * scale[n] * cos(mu[n] * middle - phase[n]) * mean / kA
    place = centre / screw_m * (len(table_C) - 1)
    low = min(lrint(floor(place)), len(table_C) - 2)
    right = place - low
    for r in range(len(C)):
        C[r] += share * ((1.0 - right) * table_C[low, r] + right * table_C[low + 1, r])


def add_waves(B, share, x, half, mu):
    """Add `share` of the means over x ± half of cos(μ x) and, behind them, of sin(μ x), for μ evenly spaced
    from 0: each follows from the one before it by a turn of the angle.
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
