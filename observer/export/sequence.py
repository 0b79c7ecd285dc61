"""The steps after an estimate, in the same subset of Python as `algorithm`, and the order of all parts."""

from __future__ import annotations

from typing import Any

from observer.export.algorithm import (
    begin,
    choose,
    correct,
    expect,
    follow,
    gate,
    heat,
    level,
    predict,
    read,
    report,
    start,
    update_inputs,
)

real = float


def judge(c: Any, v: Any) -> None:
    """Set the qualities: 0 good, 1 starting, 2 degraded, 3 stale, 4 invalid; for sensors see the output."""
    good: int = 0
    lacking: bool = False
    sane: bool = v.started
    for i in range(c.SENSORS):
        v.sensor_quality[i] = 0
        if v.suspect[i] > 0:
            v.sensor_quality[i] = 3
        if v.late[c.SENSOR_AT[i]]:
            v.sensor_quality[i] = 2
        if not v.seen[c.SENSOR_AT[i]]:
            v.sensor_quality[i] = 1
        if v.sensor_quality[i] == 0:
            good += 1
    for i in range(c.INPUTS):
        if c.NEEDED[i] == 1 and v.late[i]:
            lacking = True
    for a in range(c.STATES + c.HEATS):
        if not (v.x[a] > -c.SANE and v.x[a] < c.SANE):
            sane = False
    if good > 0:
        v.silent = 0
    elif v.silent < c.LONG:
        v.silent += 1
    if v.since < c.SETTLED:
        v.since += 1
    v.quality = 0
    if v.since < c.SETTLED:
        v.quality = 1
    if lacking or good < c.SENSORS or v.chosen == c.NONE:
        v.quality = 2
    if v.silent > c.SILENT:
        v.quality = 3
    if not sane:
        v.quality = 4
        v.started = False


def tension(c: Any, v: Any) -> None:
    """Compute the axial force of a screw held at both ends, tension positive; the last row is its free
    growth.
    """
    v.force_N = c.STIFFNESS_N_UM * (c.LOST_UM - v.row[c.ROWS - 1])


def compensate(c: Any, v: Any) -> None:
    """Move the control's table towards the thermal error, within limits of rate and slope; a rising `enable`
    arms it.

    It is disarmed by an estimate that is not good or too large, and when the heartbeat has stopped. The table
    then goes to zero at the limited rate, and only a new rising edge of `enable` arms it again.
    """
    if v.heartbeat == v.heartbeat_before:
        if v.still < c.LONG:
            v.still += 1
    else:
        v.still = 0
    v.heartbeat_before = v.heartbeat
    fit: bool = v.quality == 0 and v.still <= c.STILL
    for p in range(c.TABLE):
        v.wanted_um[p] = c.DIRECTION * (
            (1.0 - c.TABLE_RIGHT[p]) * v.error_um[c.TABLE_LOW[p]]
            + c.TABLE_RIGHT[p] * v.error_um[c.TABLE_LOW[p] + 1]
        )
        if abs(v.wanted_um[p]) > c.LIMIT_UM:
            fit = False
    if v.enable and not v.enabled and fit:
        v.latched = True
    if not v.enable or not fit:
        v.latched = False
    v.armed = v.latched
    v.enabled = v.enable
    v.running_um[0] = 0.0
    for p in range(1, c.TABLE):
        rise_um: float = v.wanted_um[p] - v.wanted_um[p - 1]
        v.running_um[p] = v.running_um[p - 1] + min(max(rise_um, -c.MOST_RISE_UM), c.MOST_RISE_UM)
    kept_um: float = v.wanted_um[c.TABLE_REFERENCE] - v.running_um[c.TABLE_REFERENCE]
    for p in range(c.TABLE):
        toward_um: float = 0.0
        if v.latched:
            toward_um = v.running_um[p] + kept_um
        v.table_um[p] += min(max(toward_um - v.table_um[p], -c.MOST_STEP_UM), c.MOST_STEP_UM)
        v.compensation_um[p] = v.table_um[p]


def at_nut(c: Any, v: Any) -> None:
    """Interpolate error and compensation at the last position of the nut."""
    here_m: float = v.value[c.NUT_CHANNEL]
    low: int = 0
    for g in range(1, c.GRID - 1):
        if here_m >= c.GRID_M[g]:
            low = g
    right: float = min(max((here_m - c.GRID_M[low]) * c.GRID_1_M[low], 0.0), 1.0)
    v.error_nut_um = c.DIRECTION * ((1.0 - right) * v.error_um[low] + right * v.error_um[low + 1])
    place: float = min(max((here_m - c.TRAVEL_M) * c.TABLE_1_M, 0.0), c.LAST_POINT)
    low = int(place)
    if low > c.TABLE - 2:
        low = c.TABLE - 2
    right = place - real(low)
    v.compensation_nut_um = (1.0 - right) * v.compensation_um[low] + right * v.compensation_um[low + 1]


def hold(c: Any, v: Any) -> None:
    """Hold the model's known inputs over the step."""
    for q in range(c.KNOWN):
        v.z_before[q] = v.z[q]


def warm(c: Any, v: Any) -> None:
    """At the model's first step, set one temperature, and lags at rest under their heats."""
    if not v.started:
        v.started = True
        for a in range(c.STATES):
            v.x[a] = c.UNIFORM[a] * v.start_degC
            for j in range(c.SOURCES):
                v.x[a] += v.law_W[j] * c.LAGS[j][a]


def sense(c: Any, v: Any) -> None:
    """Copy the readings that the model's sensors would have."""
    for i in range(c.SENSORS):
        v.sensor_degC[i] = v.row[i]


def beat(c: Any, v: Any) -> None:
    """Count the step, from 0 again after `LONG`."""
    v.beats += 1
    if v.beats > c.LONG:
        v.beats = 0
    v.alive = v.beats


ESTIMATE = (
    read, update_inputs, heat, begin, follow, predict, start, expect, level, expect, choose, gate, choose,
    correct, report, judge,
)  # fmt: skip
"""The parts of a step, in order."""
TENSION = (tension,)
"""The part where the screw is held at both ends."""
COMPENSATE = (compensate,)
"""The parts where the machine's thermal error is known …"""
AT_NUT = (at_nut,)
"""… and where a nut's position is."""
MODEL = (begin, hold, follow, predict, warm, report, sense)
"""The parts of a step of the plant alone; the first only starts it."""
