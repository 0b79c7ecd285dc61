"""The open-loop gap: the residual of a prediction that is not corrected, monitored over hours.

Beside the estimator, which corrects its heats until they agree with the sensors, a prediction runs whose
heats follow the laws; it may only be off as far as `[tolerance]` and the laws' `law_uncertainty` allow (see
`observer.estimators.tolerant`). The residual, and its allowed size, are gathered by sensor and phase of the
machine's work. While the residual exceeds what is allowed, nothing more is learnt of the machine, so that the
departure stays visible.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

from observer.estimators.tolerant import ModelGap, Tolerant, TolerantState, gathered
from observer.frames import FloatArray, Inputs
from observer.model.cycle import DWELL_S, FAST, PHASES

STEP_S = 60.0
"""Length of a step of the prediction."""
HOURS = 4.0
"""Time constant of the sums, in hours of the work concerned."""
LEAST_H = 1.0
"""Hours of work before anything is reported …"""
LEAST_REST_H = 0.25
"""… or hours at rest."""
LIMIT, LIMIT_OFF = 1.3, 1.0
"""Ratios of a sensor's gap to the allowed one at which a report begins and ends."""
BREAK_S = 300.0
"""After this time without an input the prediction restarts from the sensors."""
HARDLY_WARM_K = 1.0
"""A machine that neither works nor is much warmer than the air is at rest: only sensors are judged."""
WORKS = 0.02
"""The machine is at work if a law exceeds this fraction of the largest heat of any law."""
FASTEST_FADES_S = 4 * 86_400.0
"""Time constant for forgetting the fastest warming seen."""
_COMPACT = 256  # number of blocks kept separate, whatever the period
_REST = PHASES.index("isothermal")
_WARM, _STEADY = PHASES.index("heat_up"), PHASES.index("steady")
_DWELL, _COOL = PHASES.index("dwell"), PHASES.index("cool_down")


@dataclass(frozen=True, slots=True)
class GapState:
    """The state after a step, for s sensors.

    Attributes:
        time_s: When the step ended; NaN before the first or after a break.
        x: The prediction's states, those of `TolerantState`.
        theta: Its parameters.
        P: Their covariance.
        sums: Fading integrals of gap², allowed² and time, in K² s and s, (phases, s, 3).
        waiting: The same over a standstill that may be a dwell or a cool-down, (s, 3).
        stood_s: How long that standstill has lasted.
        judged_s: The time of work.
        rise_K: The mean rise of the sensors above the air; NaN before two steps.
        fastest_K_s: Its fastest growth, which fades over days.
        most_W: The largest heat of any law.
        last_s: Since when a gap is reported; NaN without one.
        sensor: The index of the sensor with the largest ratio then; −1 without.
        phase: The index of the phase in which that is largest; −1 without.
    """

    time_s: float
    x: FloatArray
    theta: FloatArray
    P: FloatArray
    sums: FloatArray
    waiting: FloatArray
    stood_s: float
    judged_s: float
    rise_K: float
    fastest_K_s: float
    most_W: float
    last_s: float
    sensor: int
    phase: int


class Departure(NamedTuple):
    """A gap beyond the allowed one.

    Attributes:
        sensor: The sensor at which it is largest.
        since_s: When it began.
        phase: The phase of work in which it is largest, one of `PHASES`.
        rms_K: Its root mean square, in K.
        allowed_K: The root mean square that the tolerances allow.
    """

    sensor: str
    since_s: float
    phase: str
    rms_K: float
    allowed_K: float


class GapWatch:
    """Watches the gap; nothing that it does influences an estimate.

    Attributes:
        state: The state that a checkpoint keeps.
    """

    def __init__(self, tolerant: Tolerant, sensors: tuple[str, ...]) -> None:
        """Begin with nothing known of the machine.

        Args:
            tolerant: The prediction with the tolerances of its parameters.
            sensors: The names of the s sensors.
        """
        self._tolerant = tolerant
        self._sensors = sensors
        self.state = self.initial()
        self._parts: list[Inputs] = []
        self._minute = math.nan
        self._most = 0.0
        self._departures: list[Departure] = []

    def initial(self) -> GapState:
        """Return the state before the first input."""
        s, begin = len(self._sensors), self._tolerant.initial()
        unknown = math.nan
        return GapState(
            unknown, begin.x, begin.theta, begin.P, np.zeros((len(PHASES), s, 3)), np.zeros((s, 3)), 0.0, 0.0,
            unknown, 0.0, 0.0, unknown, -1, -1,
        )  # fmt: skip

    def restore(self, state: GapState) -> None:
        """Continue from a state; inputs of the minute that was not complete are dropped."""
        self.state, self._parts, self._minute = state, [], math.nan

    def reset(self) -> None:
        """Restart the prediction from the sensors; what was learnt of the machine stays."""
        self.restore(replace(self.state, time_s=math.nan))

    def take(self, inputs: Inputs) -> None:
        """Take the inputs of K steps of the estimator, in order.

        The prediction advances once a minute of the inputs' time, so the last minute waits for its end.
        """
        minutes = np.floor(inputs.time_s / STEP_S)
        turns = np.flatnonzero(np.diff(minutes)) + 1 if len(inputs) > 1 else ()
        edges = [0, *map(int, turns), len(inputs)]
        for a, b in pairwise(edges):
            if minutes[a] != self._minute:
                self._finish()
                self._minute = float(minutes[a])
            self._parts.append(inputs if b - a == len(inputs) else inputs.part(a, b))
            if len(self._parts) >= _COMPACT:
                self._parts = [gathered(self._parts)]

    def _finish(self) -> None:
        """Take the prediction over the minute that is complete."""
        parts, self._parts = self._parts, []
        if parts:
            self.state = self._stepped(self.state, gathered(parts))
            self._most = max(self._most, self.of_allowed)
            if (now := self.departure) is not None:
                if self._departures and self._departures[-1].since_s == now.since_s:
                    self._departures.pop()
                self._departures.append(now)

    def _stepped(self, state: GapState, u: Inputs) -> GapState:
        time_s = float(u.time_s[0])
        if u.degraded[0] or not (np.isfinite(u.z_start).all() and np.isfinite(u.z_end).all()):
            return replace(state, time_s=math.nan)
        before = TolerantState(state.x, state.theta, state.P)
        if not 0.0 < time_s - state.time_s <= BREAK_S:
            if not u.usable.any():
                return state
            x, theta, P = self._tolerant.begin(before, u)
            return replace(state, time_s=time_s, x=x, theta=theta, P=P, rise_K=math.nan)
        u = u._replace(dt_s=np.array([time_s - state.time_s]))
        after, gap = self._tolerant.ahead(before, u, learn=math.isnan(state.last_s))
        if not all(np.isfinite(array).all() for array in (after.x, after.theta, after.P)):
            return self.initial()  # no estimate depends on it, so it must not end one
        return self._judged(state, u, after, gap)

    def _judged(self, state: GapState, u: Inputs, after: TolerantState, gap: ModelGap) -> GapState:
        """The state after a step of the prediction, with its gap added to the sums of the machine's phase."""
        dt_s, rise_K = float(u.dt_s[0]), float(np.mean(gap.rise_K))
        heat_W = float(np.max(np.abs(u.law_W), initial=0.0))
        rate_K_s = 0.0 if math.isnan(state.rise_K) else (rise_K - state.rise_K) / dt_s
        state = replace(
            state,
            time_s=float(u.time_s[0]),
            x=after.x,
            theta=after.theta,
            P=after.P,
            rise_K=rise_K,
            fastest_K_s=max(state.fastest_K_s * math.exp(-dt_s / FASTEST_FADES_S), rate_K_s),
            most_W=max(state.most_W, heat_W),
        )
        is_known = np.isfinite(gap.gap_K)
        gap_K, allowed_K = (np.where(is_known, K, 0.0) for K in (gap.gap_K, gap.allowed_K))
        squares = [gap_K**2, allowed_K**2, is_known]
        new = dt_s * np.column_stack(squares)
        if heat_W > WORKS * state.most_W:
            phase = _WARM if rate_K_s > FAST * state.fastest_K_s else _STEADY
            state = _gathered(
                _resolved(state, _DWELL if state.stood_s < DWELL_S else _COOL), phase, new, dt_s
            )
        elif float(np.max(np.abs(gap.rise_K))) < HARDLY_WARM_K:
            state = _gathered(_resolved(state, _COOL), _REST, new, dt_s)
        else:
            state = replace(state, waiting=state.waiting + new, stood_s=state.stood_s + dt_s)
            if state.stood_s >= DWELL_S:
                state = replace(_resolved(state, _COOL), stood_s=state.stood_s)
        return self._reported(state)

    def _reported(self, state: GapState) -> GapState:
        """The state, with the departure to be reported, if any."""
        ratio = _ratios(state.sums)
        worst = int(np.argmax(ratio))
        if ratio[worst] > (LIMIT if math.isnan(state.last_s) else LIMIT_OFF):
            since_s = state.time_s if math.isnan(state.last_s) else state.last_s
            return replace(state, last_s=since_s, sensor=worst, phase=_phase(state.sums, worst))
        return replace(state, last_s=math.nan, sensor=-1, phase=-1)

    @property
    def of_allowed(self) -> float:
        """The largest ratio of any sensor's gap to the allowed one; 0 before there is enough work or rest."""
        return float(np.max(_ratios(self.state.sums), initial=0.0))

    @property
    def departure(self) -> Departure | None:
        """The departure reported now; None without. It begins at a ratio of 1.3 and ends at 1."""
        state = self.state
        if math.isnan(state.last_s):
            return None
        parts = (state.sums[_REST + 1 :].sum(axis=0), state.sums[_REST])
        gap_K, allowed_K = max(
            (_rms(part[[state.sensor]]) for part in parts), key=lambda rms_K: float(rms_K[0][0])
        )
        name, phase = self._sensors[state.sensor], PHASES[state.phase]
        return Departure(name, state.last_s, phase, float(gap_K[0]), float(allowed_K[0]))

    @property
    def history(self) -> dict[str, Any]:
        """For the summary of a replay: the figures at the end, the largest ratio of any sensor, and every
        departure.
        """
        departures = [
            {"sensor": d.sensor, "since_s": d.since_s, "phase": d.phase, "rms_K": round(d.rms_K, 3),
             "allowed_K": round(d.allowed_K, 3)}
            for d in self._departures
        ]  # fmt: skip
        return {"now": self.figures, "most_of_allowed": round(self._most, 3), "departures": departures}

    @property
    def figures(self) -> dict[str, Any] | None:
        """The figures for health: hours, gap and allowed gap in K rms, by sensor and in all; None before an
        hour of work.
        """
        state = self.state
        work = state.sums[_REST + 1 :].sum(axis=0)
        if state.judged_s < 3600.0 * LEAST_H or not work[:, 2].any():
            return None
        gap_K, _ = _rms(work)
        total = _rms(work.sum(axis=0)[None])
        departed = not math.isnan(state.last_s)
        return {
            "hours": round(state.judged_s / 3600.0, 2),
            "rms_K": round(float(total[0][0]), 3),
            "allowed_K": round(float(total[1][0]), 3),
            "per_sensor": {
                name: round(float(rms_K), 3) if seen_s else None
                for name, rms_K, seen_s in zip(self._sensors, gap_K, work[:, 2], strict=True)
            },
            "since_s": state.last_s if departed else None,
            "sensor": self._sensors[state.sensor] if departed else None,
            "phase": PHASES[state.phase] if departed else None,
        }


def _resolved(state: GapState, phase: int) -> GapState:
    """The state once the kind of a standstill is known."""
    if state.stood_s == 0.0:
        return state
    spent_s = float(state.waiting[:, 2].max())
    zero = np.zeros_like(state.waiting)
    return replace(_gathered(state, phase, state.waiting, spent_s), waiting=zero, stood_s=0.0)


def _gathered(state: GapState, phase: int, new: FloatArray, spent_s: float) -> GapState:
    """The state with new sums of a phase, by which those of work, or those of rest, have faded."""
    part = slice(_REST, _REST + 1) if phase == _REST else slice(_REST + 1, None)
    sums = state.sums.copy()
    sums[part] *= math.exp(-spent_s / (3600.0 * HOURS))
    sums[phase] += new
    return replace(state, sums=sums, judged_s=state.judged_s + (0.0 if phase == _REST else spent_s))


def _ratios(sums: FloatArray) -> FloatArray:
    """Each sensor's gap over what is allowed (s,), at work or at rest; 0 where too little is there."""
    ratios = []
    for part, least_h in ((sums[_REST + 1 :].sum(axis=0), LEAST_H), (sums[_REST], LEAST_REST_H)):
        enough = part[:, 2] >= 3600.0 * least_h
        ratios.append(np.where(enough, np.sqrt(part[:, 0] / np.maximum(part[:, 1], 1e-12)), 0.0))
    return np.asarray(np.max(ratios, axis=0))


def _phase(sums: FloatArray, sensor: int) -> int:
    """In which phase a sensor's gap is furthest beyond what is allowed, by index into `PHASES`."""
    gap_K2, allowed_K2, count = sums[:, sensor].T
    return int(np.argmax(np.where(count > 0.0, gap_K2 / np.maximum(allowed_K2, 1e-12), 0.0)))


def _rms(sums: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The rms of the gap and of the allowed gap (s,), K."""
    count = np.maximum(sums[:, 2], 1e-12)
    return np.sqrt(sums[:, 0] / count), np.sqrt(sums[:, 1] / count)
