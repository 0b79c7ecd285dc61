"""Which readings may correct at all, before the update: what no heat can do is the sensors' doing.

A temperature on steel changes slowly, so an innovation that steps from one sample to the next is a fault of
the sensor, of several, or of what they share. The pattern of the steps says which: one or some alone are
excluded; equal steps of all are a common offset (a reference junction); two readings that take each other's
place are swapped; steps in proportion to the rise above the air are a gain; any other step of all cannot be
explained. Who is at fault where readings depart slowly, the bank beside the estimate finds out
(`observer.estimators.bank`). An excluded sensor comes back only after it has agreed for ten minutes with what
was estimated without it, and with its offset open. Agreement proves little where the rest knows little, so
the sensor must have stepped back first, or the rest must know four times better than it was off. Of readings
that were exchanged only a step counts, of both plugs put right (Brown and Chin 1998).
"""

from __future__ import annotations

from observer.kernels.codes import (
    AGE_S,
    AGREES_S,
    AIR_LEAPT,
    AIR_OFF_K,
    AIR_S,
    AIR_SEEN,
    BACK,
    CAUSE,
    COMMON_K,
    COMMON_S,
    EXCESS_K,
    EXCESS_SIGMA_K,
    FACTOR,
    FIRST_S,
    GAIN,
    GOOD,
    HOLD_S,
    JUMPED,
    LATCH,
    LATCH_S,
    MEAN,
    NO_OFFSET,
    OFFSET,
    OPENED_COMMON_K2,
    OPENED_K2,
    OPENED_PRIOR,
    OTHER,
    OUT_S,
    PENDING,
    PENDING_S,
    RESTLESS,
    RUNS_S,
    SEEN,
    SETTLING_S,
    SINCE_S,
    SIZE_K,
    STEP_K,
    STEPS,
    SWAPPED,
    UNEQUAL,
    UNREST,
    AIR_degC,
    VALUE_degC,
)
from observer.kernels.judging import QUIET_S, add_prior, defer_readmitted, gate, inflate_for_rejected
from observer.kernels.libc import exp, isfinite, isnan, sqrt

JUMP_SIGMA = 6.0
LEAST_JUMP_K = 0.15
DRIFT_K_S = 0.02
"""How fast an innovation may change by what the model does not know, as a law that is wrong by a third."""
YOUNG_S = 600.0  # for so long after a start, or after an input was lost, the model may be the wrong one
_FEW = 5.0
_MEAN_S = 15.0
LASTS_SAMPLES, LASTS_S = 3.0, 2.0
_EQUAL_K, _EQUAL_SIGMA = 0.12, 4.0
_UNREST, _UNREST_SHARE = 1.0 / 30.0, 0.3
_EXCESS_S = 30.0
READMIT_S = 600.0
_READMIT_SIGMA, _READMIT_K2 = 3.0, 1.0
_BACK, _TELLING = 0.3, 4.0
_CLEARLY_OFF = 10.0  # standard deviations of its noise that an exchanged reading is off before it steps back
_COMMON_K2, _APART_K2, _SURPRISE_K2 = 0.01, 9.0, 4.0
DECIDED_S, _SETTLING_S, _SURPRISED_S = 60.0, 120.0, 600.0
_TRUST_AIR_K = 0.5
_LEAST_LEAP_K, _LEAP_K_S = 2.0, 0.01  # of the air's reading, and for each second that it has not changed


def screen(p, u, k, gate_sigma, state, work):
    """Which usable sensors may correct; return whether P was opened: then they are to be compared anew."""
    guard, verdict, dt_s = state.guard, state.verdict, u.dt_s[k]
    pass_time(u, k, verdict)
    watch_air(p, u, k, verdict)
    for i in range(len(guard)):
        guard[i, SINCE_S] += dt_s
        look_at(i, guard, verdict, state, work)
    opened = False
    if is_decided(guard):
        opened = decide(p, u, k, state)
    for i in range(len(guard)):
        if guard[i, PENDING] > 0.0 or guard[i, CAUSE] != 0.0:
            work.usable[i] = False
    opened = refuse(p, u, k, gate_sigma, state, work) or opened
    for i in range(len(guard)):
        opened = remember(p, u, k, i, state, work) or opened
    return opened


def pass_time(u, k, verdict):
    """Count the times on; after an input was lost, the model may be wrong again."""
    verdict[AGE_S] = verdict[AGE_S] + u.dt_s[k] if u.degraded[k] == 0 else 0.0
    verdict[RUNS_S] += u.dt_s[k]
    verdict[SETTLING_S] = max(0.0, verdict[SETTLING_S] - u.dt_s[k])
    verdict[HOLD_S] = max(0.0, verdict[HOLD_S] - u.dt_s[k])


def watch_air(p, u, k, verdict):
    """Find a leap of the air's reading, which no air makes; a leap back undoes it."""
    if len(p.learn.kind) == 0:
        return
    air_degC = u.z_end[k, p.learn.ambient]
    leap_K = air_degC - verdict[AIR_degC]
    verdict[AIR_S] += u.dt_s[k]
    if leap_K == 0.0 or not isfinite(air_degC):
        return
    if verdict[AIR_SEEN] > 0.0 and abs(leap_K) > _LEAST_LEAP_K + _LEAP_K_S * verdict[AIR_S]:
        verdict[AIR_OFF_K] += leap_K
        if verdict[LATCH] == 0.0:
            verdict[LATCH], verdict[LATCH_S] = AIR_LEAPT, u.time_s[k]
        if abs(verdict[AIR_OFF_K]) <= _LEAST_LEAP_K:
            verdict[AIR_OFF_K] = 0.0
        if verdict[LATCH] == AIR_LEAPT:
            verdict[FACTOR] = verdict[AIR_OFF_K]
            if verdict[AIR_OFF_K] == 0.0:
                verdict[LATCH] = 0.0
                verdict[SETTLING_S] = max(verdict[SETTLING_S], _SETTLING_S)
    verdict[AIR_degC], verdict[AIR_S], verdict[AIR_SEEN] = air_degC, 0.0, 1.0


def look_at(i, guard, verdict, state, work):
    """Count whether sensor i has stepped, if a sample came."""
    if not work.usable[i] or guard[i, CAUSE] != 0.0:
        return
    step_K = work.nu[i] - guard[i, MEAN]
    limit_K = max(JUMP_SIGMA * sqrt(work.S_nu[i]), LEAST_JUMP_K) + DRIFT_K_S * guard[i, SINCE_S]
    judged = guard[i, SEEN] >= _FEW and verdict[AGE_S] > QUIET_S
    if judged and not abs(step_K) <= limit_K:
        guard[i, PENDING_S] += guard[i, SINCE_S] if guard[i, PENDING] > 0.0 else 0.0
        guard[i, PENDING] += 1.0
        guard[i, STEP_K] += (step_K - guard[i, STEP_K]) / guard[i, PENDING]
        guard[i, UNREST] += _UNREST * (1.0 - guard[i, UNREST])
        state.suspect[i] = 1.0
    else:
        if guard[i, PENDING] > 0.0:
            state.suspect[i] = 0.0
        settle(guard, i)
        guard[i, UNREST] -= _UNREST * guard[i, UNREST]


def settle(guard, i):
    """Forget that sensor i has stepped."""
    guard[i, PENDING], guard[i, PENDING_S], guard[i, STEP_K] = 0.0, 0.0, 0.0


def is_decided(guard):
    """Whether a step has lasted for so long that it is none of a single sample."""
    decided = False
    for i in range(len(guard)):
        lasted = guard[i, PENDING] >= LASTS_SAMPLES and guard[i, PENDING_S] >= LASTS_S
        decided = decided or lasted or guard[i, UNREST] >= _UNREST_SHARE
    return decided


def decide(p, u, k, state):
    """Say what stepped, and act on it; return whether P was opened."""
    guard, verdict = state.guard, state.verdict
    present, stepped, mean_K = 0, 0, 0.0
    for i in range(len(guard)):  # a displacement shares no reference junction
        if p.thermal[i] and guard[i, CAUSE] == 0.0 and u.quality[k, i] == GOOD:
            present += 1
            if guard[i, PENDING] > 0.0:
                stepped += 1
                mean_K += guard[i, STEP_K]
    verdict[HOLD_S] = DECIDED_S
    if stepped == present and present > 1:
        open_all(p, u, k, mean_K / present, state)
        for i in range(len(guard)):
            if p.thermal[i]:
                forget_step(guard, i)
                state.suspect[i] = 0.0
        return True
    other = swapped_with(p, guard) if stepped == 2 else -1
    for i in range(len(guard)):
        if guard[i, CAUSE] != 0.0:
            continue
        if guard[i, PENDING] > 0.0:
            exclude(u, k, i, SWAPPED if other >= 0 else JUMPED, state)
            guard[i, OTHER] = other - i
        elif guard[i, UNREST] >= _UNREST_SHARE:
            exclude(u, k, i, RESTLESS, state)
    return False


def swapped_with(p, guard):
    """The sum of the two sensors that stepped, if each now reads what the other read; else -1."""
    first, second = -1, -1
    for i in range(len(guard)):
        if p.thermal[i] and guard[i, CAUSE] == 0.0 and guard[i, PENDING] > 0.0:
            first, second = second, i
    apart_K = guard[second, VALUE_degC] - guard[first, VALUE_degC]
    limit_K = max(_EQUAL_K, _EQUAL_SIGMA * sqrt(p.R_K2[first] + p.R_K2[second]))
    if abs(guard[first, STEP_K] - apart_K) <= limit_K and abs(guard[second, STEP_K] + apart_K) <= limit_K:
        return first + second
    return -1


def exclude(u, k, i, cause, state):
    """Leave sensor i out from now on."""
    guard = state.guard
    guard[i, CAUSE], guard[i, OUT_S], guard[i, AGREES_S] = cause, 0.0, 0.0
    guard[i, EXCESS_K] = guard[i, SIZE_K] = guard[i, STEP_K]
    guard[i, BACK] = 0.0
    if guard[i, STEPS] == 0.0:
        guard[i, FIRST_S] = u.time_s[k]
    forget_step(guard, i)
    state.suspect[i], state.refused_s[i], state.opened_K[i] = 0.0, 0.0, 0.0


def forget_step(guard, i):
    """Begin the mean of sensor i's innovations afresh."""
    settle(guard, i)
    guard[i, MEAN], guard[i, SEEN], guard[i, UNREST] = 0.0, 0.0, 0.0


def open_all(p, u, k, mean_K, state):
    """All have stepped: take an equal step out of what they read; nothing else can be explained."""
    guard, verdict = state.guard, state.verdict
    equal, factor, free = True, gain_of(p, u, k, guard), 0
    for i in range(len(guard)):
        if p.thermal[i] and guard[i, CAUSE] == 0.0 and guard[i, PENDING] > 0.0:
            limit_K = max(_EQUAL_K, _EQUAL_SIGMA * sqrt(p.R_K2[i]))
            equal = equal and abs(guard[i, STEP_K] - mean_K) <= limit_K
            free += 1 if offset_of(p, i) >= 0 else -len(guard)
    if equal and free > 0:
        open_common(p, _COMMON_K2, state.P)
        verdict[OPENED_COMMON_K2] += _COMMON_K2
        if verdict[COMMON_K] == 0.0:
            verdict[COMMON_S] = u.time_s[k]
        verdict[COMMON_K] += mean_K
        return
    for i in range(len(guard)):
        if p.thermal[i] and guard[i, CAUSE] == 0.0:
            variance_K2 = _APART_K2 + guard[i, STEP_K] * guard[i, STEP_K]
            open_offset(p, i, variance_K2, state.P)
            guard[i, OPENED_K2] += variance_K2
    if verdict[LATCH] == 0.0:
        verdict[LATCH_S] = u.time_s[k]
    verdict[LATCH] = NO_OFFSET if equal else (UNEQUAL if factor == 0.0 else GAIN)
    verdict[FACTOR] = 1.0 + factor


def gain_of(p, u, k, guard):
    """The part by which all rises above the air have changed alike; 0 if they have not."""
    product, square = 0.0, 0.0
    air_degC = u.z_end[k, p.learn.ambient] if len(p.learn.kind) > 0 else 0.0
    for i in range(len(guard)):
        if p.thermal[i] and guard[i, CAUSE] == 0.0 and guard[i, PENDING] > 0.0:
            rise_K = guard[i, VALUE_degC] - air_degC
            product += rise_K * guard[i, STEP_K]
            square += rise_K * rise_K
    factor = product / max(square, 1e-12)
    for i in range(len(guard)):
        if p.thermal[i] and guard[i, CAUSE] == 0.0 and guard[i, PENDING] > 0.0:
            rise_K = guard[i, VALUE_degC] - air_degC
            limit_K = max(_EQUAL_K, _EQUAL_SIGMA * sqrt(p.R_K2[i])) + abs(factor) * _TRUST_AIR_K
            if not abs(guard[i, STEP_K] - factor * rise_K) <= limit_K:
                return 0.0
    return factor


def offset_of(p, i):
    """Which of the learnt states is the offset of sensor i; -1 where none is learnt."""
    for q in range(p.learn.machine, len(p.learn.kind)):
        if p.learn.kind[q] == OFFSET and p.learn.of[q] == i:
            for h in range(len(p.learn.held)):
                if p.learn.held[h] == q:
                    return -1
            return q
    return -1


def open_offset(p, i, variance_K2, P):
    """Add to the variance of sensor i's offset; return whether it has one."""
    q = offset_of(p, i)
    if q < 0:
        return False
    own = len(p.uniform) + len(p.source) + q
    P[own, own] += variance_K2
    return True


def open_common(p, variance_K2, P):
    """Add to the variance of what the offsets of all thermocouples have in common."""
    first = len(p.uniform) + len(p.source)
    for i in range(len(p.R_K2)):
        for j in range(len(p.R_K2)):
            a, b = offset_of(p, i), offset_of(p, j)
            if p.thermal[i] and p.thermal[j] and a >= 0 and b >= 0:
                P[first + a, first + b] += variance_K2


def refuse(p, u, k, gate_sigma, state, work):
    """Refuse what lies beyond the gate; return whether P was opened.

    While the model may be wrong it gives way to the sensors, and the estimate settles. Later only where most
    are refused at once, without a step, has something surprised model and sensors alike: then field and
    offsets are open, and the estimate settles.
    """
    verdict = state.verdict
    released = gate(work.S_nu, gate_sigma, state, work)
    if released:
        add_prior(p, state.P, 1.0)
        verdict[OPENED_PRIOR] = 1.0
    if verdict[AGE_S] < YOUNG_S:
        if not released:
            defer_readmitted(state, work)
        share = inflate_for_rejected(p, u.dt_s[k], state, work)
        verdict[OPENED_PRIOR] += share
        if released or share > 0.0:
            verdict[SETTLING_S] = max(verdict[SETTLING_S], _SETTLING_S)
        return released or share > 0.0
    if released:
        open_common(p, _SURPRISE_K2, state.P)
        verdict[OPENED_COMMON_K2] += _SURPRISE_K2
        verdict[SETTLING_S] = _SURPRISED_S
    for i in range(len(work.usable)):
        if work.usable[i] and work.accepted[i]:
            state.refused_s[i], state.opened_K[i] = 0.0, 0.0
        elif work.usable[i] or state.refused_s[i] > 0.0:
            state.refused_s[i] += u.dt_s[k]
            verdict[HOLD_S] = DECIDED_S
    return released


def look_for_return(i, since_s, noise_K, guard, work):
    """Count for how long excluded sensor i agrees with the rest, where that proves something.

    What two exchanged sensors read may meet as a machine cools, so of them a step back is asked.
    """
    sigma_K, exchanged = sqrt(work.S_nu[i]), guard[i, CAUSE] == SWAPPED
    size_K = guard[i, MEAN] if exchanged else guard[i, SIZE_K]
    clear = not exchanged or abs(size_K) >= max(_CLEARLY_OFF * noise_K, LEAST_JUMP_K)
    back_K = guard[i, MEAN] - work.nu[i]
    if guard[i, SEEN] >= _FEW and clear and abs(back_K - size_K) <= _BACK * abs(size_K):
        guard[i, BACK] = 1.0
    guard[i, MEAN] += (1.0 - exp(-since_s / _MEAN_S)) * (work.nu[i] - guard[i, MEAN])
    if guard[i, SEEN] == 0.0:
        guard[i, MEAN] = work.nu[i]
    guard[i, SEEN] += 1.0
    proves = guard[i, BACK] > 0.0 or (not exchanged and _TELLING * sigma_K <= abs(guard[i, SIZE_K]))
    near = abs(work.nu[i]) <= _READMIT_SIGMA * sigma_K
    guard[i, AGREES_S] = guard[i, AGREES_S] + since_s if near and proves else 0.0


def remember(p, u, k, i, state, work):
    """Take in a sample of sensor i; return whether it is readmitted, its offset open."""
    guard, readmitted = state.guard, False
    if not (u.usable[k, i] and isfinite(u.y_degC[k, i])):
        return False
    since_s = guard[i, SINCE_S]
    guard[i, SINCE_S] = 0.0
    if guard[i, CAUSE] != 0.0:
        guard[i, OUT_S] += since_s
        if isnan(guard[i, EXCESS_K]):
            guard[i, EXCESS_K] = guard[i, SIZE_K] = work.nu[i]
        guard[i, EXCESS_K] += (1.0 - exp(-since_s / _EXCESS_S)) * (work.nu[i] - guard[i, EXCESS_K])
        guard[i, EXCESS_SIGMA_K] = sqrt(work.S_nu[i])
        look_for_return(i, since_s, sqrt(p.R_K2[i]), guard, work)
        if guard[i, AGREES_S] >= READMIT_S and open_offset(p, i, _READMIT_K2, state.P):
            guard[i, CAUSE], readmitted = 0.0, True
            guard[i, OPENED_K2] += _READMIT_K2
            forget_step(guard, i)
    elif work.accepted[i]:
        share = (1.0 - exp(-since_s / _MEAN_S)) * p.R_K2[i] / work.S_nu[i]  # little from what was not known
        guard[i, MEAN] += share * (work.nu[i] - guard[i, MEAN])
        guard[i, SEEN] += 1.0
        guard[i, VALUE_degC] = u.y_degC[k, i] - state.verdict[COMMON_K]
    return readmitted
