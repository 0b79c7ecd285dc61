"""One step of the reduced observer, in the subset of Python that `dialect` translates to other languages.

Constants are in `c`. Inputs, outputs, state and scratch arrays are in `v`, all zero at first. Loops have a
constant number of turns, and no divisor can be zero. `data` describes each array with its shape. The steps
after the estimate, and the order of all parts, are in `sequence`.

The arithmetic is that of the constant gain of `observer.kernels.fixed_gain` in its steady state, with one
step length. The differences are listed in docs/how-to/export-to-a-controller.md.
"""

from __future__ import annotations

from typing import Any

real = float


def read(c: Any, v: Any) -> None:
    """Take new plausible values; a channel without one keeps its last value, a step older."""
    for i in range(c.INPUTS):
        v.came[i] = v.fresh[i] and (v.reading[i] >= c.LOW[i] and v.reading[i] <= c.HIGH[i])
        if v.came[i]:
            v.value[i] = v.reading[i]
            v.age[i] = 0
            v.seen[i] = True
        elif v.age[i] < c.LONG:
            v.age[i] += 1
        v.late[i] = not v.seen[i] or v.age[i] > c.LIMIT[i]
        v.age_s[i] = c.PERIOD_S * real(v.age[i])


def update_inputs(c: Any, v: Any) -> None:
    """Set the known inputs at both ends of the step: air, prescribed ends, offsets, the error's reference."""
    v.ready = True
    for q in range(c.KNOWN):
        v.z_before[q] = v.z[q]
        if c.KNOWN_AT[q] < 0:
            v.z[q] = c.KNOWN_SHIFT[q]
        elif v.seen[c.KNOWN_AT[q]]:
            v.z[q] = v.value[c.KNOWN_AT[q]] + c.KNOWN_SHIFT[q]
        else:
            v.ready = False
    if c.REFERENCE >= 0:
        if v.ready and not v.based:
            v.reference_degC = v.value[c.AMBIENT_AT]
        v.z[c.REFERENCE] = v.reference_degC
    if v.ready and not v.based:
        v.based = True
        for q in range(c.KNOWN):
            v.z_before[q] = v.z[q]


def heat(c: Any, v: Any) -> None:
    """Compute each source's heat by its law, as the mean of both ends of the step."""
    for j in range(c.SOURCES):
        now: float = c.LAW_W[j]
        apart: float = 0.0
        for i in range(c.INPUTS):
            now += c.LAW_SIZE[j][i] * abs(v.value[i]) + c.LAW_VALUE[j][i] * v.value[i]
            apart += c.LAW_APART[j][i] * v.value[i]
            if v.value[i] > 0.0 or v.value[i] < 0.0:
                now += c.LAW_ON[j][i]
        now += abs(apart)
        if not v.begun:
            v.law_now[j] = now
        v.law_W[j] = 0.5 * (v.law_now[j] + now)
        v.law_now[j] = now


def follow(c: Any, v: Any) -> None:
    """Set a moving nut's columns: along the straight line since the last step, or spread over its stroke."""
    for i in range(c.NUTS):
        for p in range(c.PLACES + 1):
            v.weight[p] = 0.0
        if v.late[c.NUT_AT[i]]:
            v.weight[c.PLACES] = 1.0
            v.located[i] = False
        else:
            if not v.located[i]:
                v.nut_m[i] = v.value[c.NUT_AT[i]]
                v.located[i] = True
            way_m: float = v.value[c.NUT_AT[i]] - v.nut_m[i]
            for j in range(c.POINTS):
                place: float = (v.nut_m[i] + c.PART[j] * way_m) * c.PLACES_1_M
                place = min(max(place, 0.0), c.LAST_PLACE)
                low: int = int(place)
                if low > c.PLACES - 2:
                    low = c.PLACES - 2
                v.weight[low] += c.SHARE * (1.0 - (place - real(low)))
                v.weight[low + 1] += c.SHARE * (place - real(low))
            v.nut_m[i] = v.value[c.NUT_AT[i]]
        for a in range(c.STATES):
            into: float = 0.0
            for p in range(c.PLACES + 1):
                into += v.weight[p] * c.NUT_B[i][p][a]
            v.B[c.NUT_OF[i]][a] = into
        for r in range(c.ROWS):
            output_row: float = 0.0
            for p in range(c.PLACES + 1):
                output_row += v.weight[p] * c.NUT_C[i][p][r]
            if v.begun:
                v.lag_C[i][r] += c.SETTLE[i] * (output_row - v.lag_C[i][r])
            else:
                v.lag_C[i][r] = c.NUT_C[i][c.PLACES][r]


def begin(c: Any, v: Any) -> None:
    """Set the columns of fixed sources, at the first step."""
    if not v.begun:
        for j in range(c.SOURCES):
            for a in range(c.STATES):
                v.B[j][a] = c.B[j][a]


def predict(c: Any, v: Any) -> None:
    """Advance the states by one exact step of a diagonal plant.

    It applies decay, heats, known inputs, and the heats' deviations from their laws.
    """
    v.begun = True
    if v.started:
        for a in range(c.STATES):
            driven: float = 0.0
            rising: float = 0.0
            for j in range(c.SOURCES):
                driven += v.B[j][a] * v.law_W[j]
            for q in range(c.KNOWN):
                driven += c.E[q][a] * v.z_before[q]
                rising += c.E[q][a] * (v.z[q] - v.z_before[q])
            v.x[a] = c.DECAY[a] * v.x[a] + c.HOLD[a] * driven + c.RAMP[a] * rising
            for j in range(c.HEATS):
                v.x[a] += v.B[c.HEAT_OF[j]][a] * c.COUPLE[j][a] * v.x[c.STATES + j]
        for j in range(c.HEATS):
            v.x[c.STATES + j] = c.HEAT_DECAY[j] * v.x[c.STATES + j]


def start(c: Any, v: Any) -> None:
    """At the first reading, begin with a screw of zero temperature and lags at rest; `level` adds its
    temperature.
    """
    v.opened = False
    v.judged = False
    v.count = 0
    for i in range(c.SENSORS):
        v.usable[i] = v.ready and v.came[c.SENSOR_AT[i]]
        if v.usable[i]:
            v.count += 1
    if not v.started and v.count > 0:
        for a in range(c.STATES + c.HEATS):
            v.x[a] = 0.0
        for a in range(c.STATES):
            for j in range(c.SOURCES):
                v.x[a] += v.law_W[j] * c.LAGS[j][a]


def expect(c: Any, v: Any) -> None:
    """Compute the innovation of each sensor: measured minus predicted."""
    for i in range(c.SENSORS):
        expected: float = 0.0
        for a in range(c.STATES):
            expected += c.C[i][a] * v.x[a]
        for q in range(c.KNOWN):
            expected += c.F[i][q] * v.z[q]
        for p in range(c.NUTS):
            expected += v.lag_C[p][i] * v.x[c.LAG_OF[p]]
        v.innovation_K[i] = v.value[c.SENSOR_AT[i]] - expected


def level(c: Any, v: Any) -> None:
    """End the start: add the median of the screw temperatures that the usable sensors imply."""
    if not v.started and v.count > 0:
        for i in range(c.SENSORS):
            if c.SEEN[i] > 0.5:
                v.level_degC[i] = v.innovation_K[i] / c.SEEN[i]
            else:
                v.level_degC[i] = v.value[c.SENSOR_AT[i]]
        median: float = 0.0
        for i in range(c.SENSORS):
            if v.usable[i]:
                rank: int = 0
                for j in range(c.SENSORS):
                    if v.usable[j] and (
                        v.level_degC[j] < v.level_degC[i] or (j < i and v.level_degC[j] <= v.level_degC[i])
                    ):
                        rank += 1
                if rank == (v.count - 1) // 2:
                    median += 0.5 * v.level_degC[i]
                if rank == v.count // 2:
                    median += 0.5 * v.level_degC[i]
        for a in range(c.STATES):
            v.x[a] += c.UNIFORM[a] * median
        v.started = True
        v.opened = True
        v.since = 0


def choose(c: Any, v: Any) -> None:
    """Choose the gain for the sensors that are neither late nor rejected; a larger one for an inflated
    state.
    """
    first: int = c.SENSORS
    second: int = c.SENSORS
    absent: int = 0
    for i in range(c.SENSORS):
        if v.late[c.SENSOR_AT[i]] or (v.judged and v.suspect[i] > 0):
            if absent == 0:
                first = i
            else:
                second = i
            absent += 1
    v.chosen = c.NONE
    if absent <= c.MOST_ABSENT:
        v.chosen = c.SET_OF[first][second]
    if v.opened and v.chosen < c.SETS:
        v.chosen += c.SETS


def gate(c: Any, v: Any) -> None:
    """Reject readings with too large an innovation.

    If more than half of the sensors have been rejected three times in a row, accept all.
    """
    present: int = 0
    refused: int = 0
    for i in range(c.SENSORS):
        v.accepted[i] = v.usable[i]
        if v.usable[i]:
            present += 1
            if v.innovation_K[i] * v.innovation_K[i] > c.GATE_K2[v.chosen][i]:
                v.accepted[i] = False
                if v.suspect[i] < c.LONG:
                    v.suspect[i] += 1
                if v.suspect[i] >= c.RELEASE:
                    refused += 1
            else:
                v.suspect[i] = 0
    v.judged = True
    if 2 * refused > present:
        for i in range(c.SENSORS):
            v.accepted[i] = v.usable[i]
            if v.usable[i]:
                v.suspect[i] = 0
        v.opened = True
        v.since = 0


def correct(c: Any, v: Any) -> None:
    """Add gain times innovation of the accepted sensors to the state."""
    for i in range(c.SENSORS):
        if v.accepted[i]:
            for a in range(c.STATES + c.HEATS):
                v.x[a] += c.GAIN[v.chosen][i][a] * v.innovation_K[i]


def report(c: Any, v: Any) -> None:
    """Compute heats in W, and field and error on the grid."""
    for j in range(c.HEATS):
        v.heat_W[j] = v.law_W[c.HEAT_OF[j]] + v.x[c.STATES + j]
    for r in range(c.REPORTED, c.ROWS):
        total: float = 0.0
        for a in range(c.STATES):
            total += c.C[r][a] * v.x[a]
        for q in range(c.KNOWN):
            total += c.F[r][q] * v.z[q]
        for p in range(c.NUTS):
            total += v.lag_C[p][r] * v.x[c.LAG_OF[p]]
        v.row[r] = total
    for g in range(c.GRID):
        v.field_degC[g] = v.row[c.SENSORS + g]
    for g in range(c.ERRORS):
        v.error_um[g] = v.row[c.SENSORS + c.GRID + g]
