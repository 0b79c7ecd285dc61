"""Stop-and-go drilling and milling: a list of moves, and where the nut is at any time of it."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
GRAVITY_m_s2 = 9.81


@dataclass(frozen=True)
class Axis:
    """The limits of an axis: stroke of the nut's middle, rapid, acceleration."""

    stroke_m: tuple[float, float]
    rapid_m_s: float
    acceleration_m_s2: float


@dataclass(frozen=True)
class Motion:
    """Motion at times (n,): place of the nut, its velocity, and the thrust of a cut."""

    position_m: FloatArray
    velocity_m_s: FloatArray
    thrust_N: FloatArray


class Programme:
    """Moves one after the other; each begins and ends at rest, and may be followed by a wait."""

    def __init__(self, axis: Axis, rng: np.random.Generator, hours: float) -> None:
        """Draw the programme of a shift of so many hours, from a cold start on."""
        self._axis, self._rng = axis, rng
        self._rows: list[tuple[float, float, float, float, float]] = []
        self._now_s, self._at_m = 0.0, axis.stroke_m[0]
        self._draw(3600.0 * hours)
        begin_s, from_m, to_m, speed_m_s, thrust_N = np.array(self._rows).T
        self._begin_s, self._from_m, self._way_m = begin_s, from_m, to_m - from_m
        self._speed_m_s, self._thrust_N = speed_m_s, thrust_N

    def at(self, time_s: FloatArray) -> Motion:
        """Return the motion at times (n,) in seconds from the start; after the last move the axis rests."""
        move = np.maximum(np.searchsorted(self._begin_s, time_s, side="right") - 1, 0)
        way_m = np.abs(self._way_m[move])
        along_m, speed_m_s = _trapezoid(
            time_s - self._begin_s[move], way_m, self._speed_m_s[move], self._axis.acceleration_m_s2
        )
        direction = np.sign(self._way_m[move])
        moves = speed_m_s > 0.0
        return Motion(
            position_m=self._from_m[move] + direction * along_m,
            velocity_m_s=direction * speed_m_s,
            thrust_N=np.where(moves, self._thrust_N[move], 0.0),
        )

    def _draw(self, until_s: float) -> None:
        rng = self._rng
        self._wait(float(rng.uniform(20.0, 120.0)))
        while self._now_s < until_s:
            part = (self._drill, self._mill, self._hop)[rng.integers(3)]
            for _ in range(int(rng.integers(2, 7))):
                part()
                self._rapid(self._axis.stroke_m[0])
                self._wait(float(rng.uniform(3.0, 8.0)))
            pause_s = rng.uniform(300.0, 900.0) if rng.random() < 0.06 else rng.uniform(8.0, 45.0)
            self._wait(float(pause_s))

    def _drill(self) -> None:
        """A row of holes: rapid there, in three pecks down and up again."""
        rng = self._rng
        feed_m_s, thrust_N = rng.uniform(1.0, 5.0) / 60.0, float(rng.uniform(200.0, 1500.0))
        depth_m = min(float(rng.uniform(0.015, 0.04)), 0.2 * self._reach_m)
        for _ in range(int(rng.integers(4, 12))):
            top_m = float(rng.uniform(self._axis.stroke_m[0], self._axis.stroke_m[1] - depth_m))
            self._rapid(top_m)
            self._wait(float(rng.uniform(0.1, 0.6)))
            for peck in (1, 2, 3):
                self._move(top_m + depth_m * peck / 3.0, feed_m_s, thrust_N)
                self._rapid(top_m)

    def _mill(self) -> None:
        """Passes at a feed, back in rapid."""
        rng = self._rng
        feed_m_s, thrust_N = rng.uniform(3.0, 12.0) / 60.0, float(rng.uniform(100.0, 800.0))
        pass_m = self._reach_m * float(rng.uniform(0.2, 0.7))
        begin_m = float(rng.uniform(self._axis.stroke_m[0], self._axis.stroke_m[1] - pass_m))
        for _ in range(int(rng.integers(3, 10))):
            self._rapid(begin_m)
            self._move(begin_m + pass_m, float(feed_m_s), thrust_N)
            self._wait(float(rng.uniform(0.0, 1.0)))

    def _hop(self) -> None:
        """From place to place in rapid, as when an array of spots is touched."""
        for _ in range(int(self._rng.integers(10, 40))):
            self._rapid(float(self._rng.uniform(*self._axis.stroke_m)))
            self._wait(float(self._rng.uniform(0.0, 0.6)))

    @property
    def _reach_m(self) -> float:
        return self._axis.stroke_m[1] - self._axis.stroke_m[0]

    def _rapid(self, to_m: float) -> None:
        self._move(to_m, self._axis.rapid_m_s, 0.0)

    def _wait(self, seconds: float) -> None:
        self._rows.append((self._now_s, self._at_m, self._at_m, 1.0, 0.0))
        self._now_s += seconds

    def _move(self, to_m: float, speed_m_s: float, thrust_N: float) -> None:
        self._rows.append((self._now_s, self._at_m, to_m, speed_m_s, thrust_N))
        way_m, acceleration = abs(to_m - self._at_m), self._axis.acceleration_m_s2
        top_m_s = min(speed_m_s, math.sqrt(way_m * acceleration))
        self._now_s += (way_m / top_m_s + top_m_s / acceleration) if way_m > 0.0 else 0.0
        self._at_m = to_m


def _trapezoid(
    since_s: FloatArray, way_m: FloatArray, speed_m_s: FloatArray, acceleration_m_s2: float
) -> tuple[FloatArray, FloatArray]:
    """Return way and speed since the beginning of moves from rest to rest."""
    top_m_s = np.minimum(speed_m_s, np.sqrt(way_m * acceleration_m_s2))
    ramp_s = top_m_s / acceleration_m_s2
    total_s = np.divide(way_m, top_m_s, out=np.zeros_like(way_m), where=top_m_s > 0.0) + ramp_s
    before_s = np.clip(since_s, 0.0, total_s)
    left_s = total_s - before_s
    ramp_m = top_m_s * ramp_s / 2.0
    along_m = np.where(
        before_s < ramp_s,
        acceleration_m_s2 * before_s**2 / 2.0,
        np.where(
            left_s < ramp_s,
            way_m - acceleration_m_s2 * left_s**2 / 2.0,
            ramp_m + top_m_s * (before_s - ramp_s),
        ),
    )
    now_m_s = np.minimum(top_m_s, acceleration_m_s2 * np.minimum(before_s, left_s))
    return along_m, now_m_s
