"""Screening of readings before the update: changes that no heat can cause are faults of sensors.

A temperature on steel changes slowly. An innovation that steps from one sample to the next is therefore a
fault of one sensor, of several, or of a shared part. The pattern of the steps identifies the fault:

- steps of one or some sensors: these are excluded;
- equal steps of all: a common offset (a reference junction);
- two readings that exchange their values: swapped sensors;
- steps in proportion to the rise above the air: a gain;
- any other step of all sensors: unexplained.

The bank of filters finds the sensor at fault in a slow departure (`observer.estimators.bank`). An excluded
sensor is readmitted, with its offset open, after ten minutes of agreement with the estimate without it. It
must have stepped back first, or the other sensors must predict it to within a quarter of its error. Swapped
sensors must step back (Brown and Chin 1998).
"""

from __future__ import annotations

from observer.kernels.codes import (
    AIR_LEAPT,
    GAIN,
    GOOD,
    JUMPED,
    NO_OFFSET,
    OFFSET,
    RESTLESS,
    SWAPPED,
    UNEQUAL,
)
from observer.kernels.judging import QUIET_S, readmit, refuse
from observer.kernels.libc import cython, exp, isfinite, isnan, sqrt

JUMP_SIGMA = 6.0
LEAST_JUMP_K = 0.15
DRIFT_K_S = 0.02
"""Fastest change of an innovation by errors of the model, such as a law that is wrong by a third."""
YOUNG_S = 600.0  # for so long after a start, or after an input was lost, the model may be the wrong one
_LEAST_SAMPLES = 5.0
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
    """Mark the accepted sensors; return whether P was inflated, so that `compare` must run again."""
    guard, verdict = state.guard, cython.address(state.verdict[0])
    pass_time(u, k, verdict)
    watch_air(p, u, k, verdict)
    for i in range(len(guard)):
        guard[i].since_s += u.dt_s[k]
        look_at(i, cython.address(guard[i]), verdict.age_s, state, work)
    opened = False
    if is_decided(guard):
        opened = decide(p, u, k, state)
    for i in range(len(guard)):
        if guard[i].pending > 0.0 or guard[i].cause != 0.0:
            work.usable[i] = False
    opened = refuse_or_settle(p, u, k, gate_sigma, state, work) or opened
    for i in range(len(guard)):
        opened = remember(p, u, k, i, state, work) or opened
    return opened


def pass_time(u, k, verdict):
    """Count the times on; after an input was lost, the model may be wrong again."""
    verdict.age_s = verdict.age_s + u.dt_s[k] if u.degraded[k] == 0 else 0.0
    verdict.runs_s += u.dt_s[k]
    verdict.settling_s = max(0.0, verdict.settling_s - u.dt_s[k])
    verdict.hold_s = max(0.0, verdict.hold_s - u.dt_s[k])


def watch_air(p, u, k, verdict):
    """Find a leap of the air's reading, which no air makes; a leap back undoes it."""
    if len(p.learn.kind) == 0:
        return
    air_degC = u.z_end[k, p.learn.ambient]
    leap_K = air_degC - verdict.air_degC
    verdict.air_same_s += u.dt_s[k]
    if leap_K == 0.0 or not isfinite(air_degC):
        return
    if verdict.air_known > 0.0 and abs(leap_K) > _LEAST_LEAP_K + _LEAP_K_S * verdict.air_same_s:
        verdict.air_off_K += leap_K
        if verdict.latch == 0.0:
            verdict.latch, verdict.latched_s = AIR_LEAPT, u.time_s[k]
        if abs(verdict.air_off_K) <= _LEAST_LEAP_K:
            verdict.air_off_K = 0.0
        if verdict.latch == AIR_LEAPT:
            verdict.factor = verdict.air_off_K
            if verdict.air_off_K == 0.0:
                verdict.latch = 0.0
                verdict.settling_s = max(verdict.settling_s, _SETTLING_S)
    verdict.air_degC, verdict.air_same_s, verdict.air_known = air_degC, 0.0, 1.0


def look_at(i, sensor, age_s, state, work):
    """Record whether sensor i has stepped, if it has a sample."""
    if not work.usable[i] or sensor.cause != 0.0:
        return
    step_K = work.nu[i] - sensor.mean_K
    limit_K = max(JUMP_SIGMA * sqrt(work.S_nu[i]), LEAST_JUMP_K) + DRIFT_K_S * sensor.since_s
    judged = sensor.samples >= _LEAST_SAMPLES and age_s > QUIET_S
    if judged and not abs(step_K) <= limit_K:
        sensor.pending_s += sensor.since_s if sensor.pending > 0.0 else 0.0
        sensor.pending += 1.0
        sensor.step_K += (step_K - sensor.step_K) / sensor.pending
        sensor.unrest += _UNREST * (1.0 - sensor.unrest)
        state.suspect[i] = 1.0
    else:
        if sensor.pending > 0.0:
            state.suspect[i] = 0.0
        settle(sensor)
        sensor.unrest -= _UNREST * sensor.unrest


def settle(sensor):
    """Forget that a sensor has stepped."""
    sensor.pending, sensor.pending_s, sensor.step_K = 0.0, 0.0, 0.0


def is_decided(guard):
    """Return whether a step has lasted longer than a single sample."""
    decided = False
    for i in range(len(guard)):
        lasted = guard[i].pending >= LASTS_SAMPLES and guard[i].pending_s >= LASTS_S
        decided = decided or lasted or guard[i].unrest >= _UNREST_SHARE
    return decided


def decide(p, u, k, state):
    """Say what stepped, and act on it; return whether P was opened."""
    guard, verdict = state.guard, cython.address(state.verdict[0])
    present, stepped, mean_K = 0, 0, 0.0
    for i in range(len(guard)):  # a displacement shares no reference junction
        if p.thermal[i] and guard[i].cause == 0.0 and u.quality[k, i] == GOOD:
            present += 1
            if guard[i].pending > 0.0:
                stepped += 1
                mean_K += guard[i].step_K
    verdict.hold_s = DECIDED_S
    if stepped == present and present > 1:
        open_all(p, u, k, mean_K / present, state)
        for i in range(len(guard)):
            if p.thermal[i]:
                forget_step(cython.address(guard[i]))
                state.suspect[i] = 0.0
        return True
    other = swapped_with(p, guard) if stepped == 2 else -1
    for i in range(len(guard)):
        if guard[i].cause != 0.0:
            continue
        if guard[i].pending > 0.0:
            exclude(u, k, i, SWAPPED if other >= 0 else JUMPED, state)
            guard[i].partner = other - i
        elif guard[i].unrest >= _UNREST_SHARE:
            exclude(u, k, i, RESTLESS, state)
    return False


def swapped_with(p, guard):
    """The sum of the two sensors that stepped, if each now reads what the other read; else -1."""
    first, second = -1, -1
    for i in range(len(guard)):
        if p.thermal[i] and guard[i].cause == 0.0 and guard[i].pending > 0.0:
            first, second = second, i
    apart_K = guard[second].value_degC - guard[first].value_degC
    limit_K = max(_EQUAL_K, _EQUAL_SIGMA * sqrt(p.R_K2[first] + p.R_K2[second]))
    if abs(guard[first].step_K - apart_K) <= limit_K and abs(guard[second].step_K + apart_K) <= limit_K:
        return first + second
    return -1


def exclude(u, k, i, cause, state):
    """Leave sensor i out from now on."""
    sensor = cython.address(state.guard[i])
    sensor.cause, sensor.out_s, sensor.agrees_s = cause, 0.0, 0.0
    sensor.excess_K = sensor.size_K = sensor.step_K
    sensor.stepped_back = 0.0
    if sensor.steps_out == 0.0:
        sensor.first_out_s = u.time_s[k]
    forget_step(sensor)
    state.suspect[i], state.refused_s[i], state.opened_K[i] = 0.0, 0.0, 0.0


def forget_step(sensor):
    """Begin the mean of a sensor's innovations afresh."""
    settle(sensor)
    sensor.mean_K, sensor.samples, sensor.unrest = 0.0, 0.0, 0.0


def open_all(p, u, k, mean_K, state):
    """Handle a step of all sensors: subtract an equal step from the readings, or latch a fault."""
    guard, verdict = state.guard, cython.address(state.verdict[0])
    equal, factor, free = True, gain_of(p, u, k, guard), 0
    for i in range(len(guard)):
        if p.thermal[i] and guard[i].cause == 0.0 and guard[i].pending > 0.0:
            limit_K = max(_EQUAL_K, _EQUAL_SIGMA * sqrt(p.R_K2[i]))
            equal = equal and abs(guard[i].step_K - mean_K) <= limit_K
            free += 1 if offset_of(p, i) >= 0 else -len(guard)
    if equal and free > 0:
        open_common(p, _COMMON_K2, state.P)
        verdict.opened_common_K2 += _COMMON_K2
        if verdict.common_K == 0.0:
            verdict.common_from_s = u.time_s[k]
        verdict.common_K += mean_K
        return
    for i in range(len(guard)):
        if p.thermal[i] and guard[i].cause == 0.0:
            variance_K2 = _APART_K2 + guard[i].step_K * guard[i].step_K
            open_offset(p, i, variance_K2, state.P)
            guard[i].opened_K2 += variance_K2
    if verdict.latch == 0.0:
        verdict.latched_s = u.time_s[k]
    verdict.latch = NO_OFFSET if equal else (UNEQUAL if factor == 0.0 else GAIN)
    verdict.factor = 1.0 + factor


def gain_of(p, u, k, guard):
    """The part by which all rises above the air have changed alike; 0 if they have not."""
    product, square = 0.0, 0.0
    air_degC = u.z_end[k, p.learn.ambient] if len(p.learn.kind) > 0 else 0.0
    for i in range(len(guard)):
        if p.thermal[i] and guard[i].cause == 0.0 and guard[i].pending > 0.0:
            rise_K = guard[i].value_degC - air_degC
            product += rise_K * guard[i].step_K
            square += rise_K * rise_K
    factor = product / max(square, 1e-12)
    for i in range(len(guard)):
        if p.thermal[i] and guard[i].cause == 0.0 and guard[i].pending > 0.0:
            rise_K = guard[i].value_degC - air_degC
            limit_K = max(_EQUAL_K, _EQUAL_SIGMA * sqrt(p.R_K2[i])) + abs(factor) * _TRUST_AIR_K
            if not abs(guard[i].step_K - factor * rise_K) <= limit_K:
                return 0.0
    return factor


def offset_of(p, i):
    """Return the learnt parameter that is the offset of sensor i, or -1."""
    for q in range(p.learn.machine, len(p.learn.kind)):
        if p.learn.kind[q] == OFFSET and p.learn.of[q] == i:
            for h in range(len(p.learn.considered)):
                if p.learn.considered[h] == q:
                    return -1
            return q
    return -1


def open_offset(p, i, variance_K2, P):
    """Add to the variance of sensor i's offset; return whether it has one."""
    q = offset_of(p, i)
    if q < 0:
        return False
    index = len(p.uniform) + len(p.source) + q
    P[index, index] += variance_K2
    return True


def open_common(p, variance_K2, P):
    """Add a variance to the common part of all thermocouples' offsets."""
    first = len(p.uniform) + len(p.source)
    for i in range(len(p.R_K2)):
        for j in range(len(p.R_K2)):
            a, b = offset_of(p, i), offset_of(p, j)
            if p.thermal[i] and p.thermal[j] and a >= 0 and b >= 0:
                P[first + a, first + b] += variance_K2


def refuse_or_settle(p, u, k, gate_sigma, state, work):
    """Reject readings beyond the gate; return whether P was inflated.

    While the model may be wrong, P is inflated for rejected sensors, and the estimate settles. Later, field
    and offsets are opened only if most sensors are rejected at once, without a step.
    """
    verdict = cython.address(state.verdict[0])
    young = verdict.age_s < YOUNG_S
    released = refuse(work.S_nu, gate_sigma, young, state, work)
    share = readmit(p, u.dt_s[k], released, young, state, work)
    verdict.opened_prior += share
    if young and share > 0.0:
        verdict.settling_s = max(verdict.settling_s, _SETTLING_S)
    elif released:
        open_common(p, _SURPRISE_K2, state.P)
        verdict.opened_common_K2 += _SURPRISE_K2
        verdict.settling_s = _SURPRISED_S
    for i in range(len(work.usable)):
        if not young and ((work.usable[i] and not work.accepted[i]) or state.refused_s[i] > 0.0):
            verdict.hold_s = DECIDED_S
    return share > 0.0


def look_for_return(sensor, since_s, noise_K, nu, sigma_K):
    """Count the time for which an excluded sensor agrees with the others, if agreement is significant.

    Its innovation `nu` has the standard deviation `sigma_K`. Readings of swapped sensors may meet as a
    machine cools, so they must step back.
    """
    exchanged = sensor.cause == SWAPPED
    size_K = sensor.mean_K if exchanged else sensor.size_K
    clear = not exchanged or abs(size_K) >= max(_CLEARLY_OFF * noise_K, LEAST_JUMP_K)
    back_K = sensor.mean_K - nu
    if sensor.samples >= _LEAST_SAMPLES and clear and abs(back_K - size_K) <= _BACK * abs(size_K):
        sensor.stepped_back = 1.0
    sensor.mean_K += (1.0 - exp(-since_s / _MEAN_S)) * (nu - sensor.mean_K)
    if sensor.samples == 0.0:
        sensor.mean_K = nu
    sensor.samples += 1.0
    proves = sensor.stepped_back > 0.0 or (not exchanged and _TELLING * sigma_K <= abs(sensor.size_K))
    near = abs(nu) <= _READMIT_SIGMA * sigma_K
    sensor.agrees_s = sensor.agrees_s + since_s if near and proves else 0.0


def remember(p, u, k, i, state, work):
    """Take in a sample of sensor i; return whether it is readmitted, its offset open."""
    if not (u.usable[k, i] and isfinite(u.y_degC[k, i])):
        return False
    sensor, nu, sigma_K = cython.address(state.guard[i]), work.nu[i], sqrt(work.S_nu[i])
    since_s = sensor.since_s
    sensor.since_s = 0.0
    if sensor.cause != 0.0:
        sensor.out_s += since_s
        if isnan(sensor.excess_K):
            sensor.excess_K = sensor.size_K = nu
        sensor.excess_K += (1.0 - exp(-since_s / _EXCESS_S)) * (nu - sensor.excess_K)
        sensor.excess_sigma_K = sigma_K
        look_for_return(sensor, since_s, sqrt(p.R_K2[i]), nu, sigma_K)
        if sensor.agrees_s >= READMIT_S and open_offset(p, i, _READMIT_K2, state.P):
            sensor.cause = 0.0
            sensor.opened_K2 += _READMIT_K2
            forget_step(sensor)
            return True
    elif work.accepted[i]:
        share = (1.0 - exp(-since_s / _MEAN_S)) * p.R_K2[i] / work.S_nu[i]  # little from what was not known
        sensor.mean_K += share * (nu - sensor.mean_K)
        sensor.samples += 1.0
        sensor.value_degC = u.y_degC[k, i] - state.verdict[0].common_K
    return False
