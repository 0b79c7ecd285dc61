"""A machine's axis that is moved by trapezoids or S-curves; it imports nothing of the product."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]


@dataclass(frozen=True)
class Axis:
    """An axis: its travel, screw, greatest speed and acceleration; an infinite jerk makes trapezoids."""

    low_m: float
    high_m: float
    lead_m: float
    rapid_m_s: float
    acceleration_m_s2: float
    jerk_m_s3: float

    def ramp_s(self, change_m_s: float) -> float:
        """Return how long a change of speed takes."""
        change, build_up_s = abs(change_m_s), self.acceleration_m_s2 / self.jerk_m_s3
        if change >= self.acceleration_m_s2 * build_up_s:
            return change / self.acceleration_m_s2 + build_up_s
        return 2.0 * math.sqrt(change / self.jerk_m_s3)


def draw_axis(rng: np.random.Generator) -> Axis:
    """Draw an axis of up to 1 g and 60 m/min."""
    low_m, acceleration_m_s2 = rng.uniform(0.1, 0.3), 9.81 * rng.uniform(0.2, 1.0)
    jerk_m_s3 = math.inf if rng.random() < 0.5 else acceleration_m_s2 / rng.uniform(0.01, 0.06)
    rapid_m_s, lead_m = rng.uniform(0.2, 1.0), float(rng.choice([0.005, 0.01, 0.012, 0.016, 0.02, 0.025]))
    return Axis(low_m, low_m + rng.uniform(0.3, 1.2), lead_m, rapid_m_s, acceleration_m_s2, jerk_m_s3)


@dataclass
class Path:
    """What an axis did: pieces of constant jerk (start, place, velocity, acceleration, jerk)."""

    axis: Axis
    place_m: float
    time_s: float = 0.0
    velocity_m_s: float = 0.0
    pieces: list[tuple[float, float, float, float, float]] = field(default_factory=list)

    def _piece(self, seconds: float, acceleration: float = 0.0, jerk: float = 0.0) -> None:
        self.pieces.append((self.time_s, self.place_m, self.velocity_m_s, acceleration, jerk))
        self.place_m += seconds * (self.velocity_m_s + seconds * (acceleration / 2.0 + seconds * jerk / 6.0))
        self.velocity_m_s += seconds * (acceleration + seconds * jerk / 2.0)
        self.time_s += seconds

    def hold(self, seconds: float) -> None:
        """Go on as it is."""
        self._piece(seconds)

    def ramp(self, velocity_m_s: float) -> None:
        """Change the velocity."""
        change, most, jerk = (
            velocity_m_s - self.velocity_m_s,
            self.axis.acceleration_m_s2,
            self.axis.jerk_m_s3,
        )
        sense, seconds = math.copysign(1.0, change), self.axis.ramp_s(change)
        if math.isinf(jerk):
            self._piece(seconds, sense * most)
        else:
            build_up_s = min(most / jerk, seconds / 2.0)
            self._piece(build_up_s, 0.0, sense * jerk)
            self._piece(seconds - 2.0 * build_up_s, sense * jerk * build_up_s)
            self._piece(build_up_s, sense * jerk * build_up_s, -sense * jerk)
        self.velocity_m_s = velocity_m_s

    def move(self, to_m: float, speed_m_s: float) -> None:
        """Move to a place, from rest to rest."""
        to_m = min(max(to_m, self.axis.low_m), self.axis.high_m)
        way_m, low, high = abs(to_m - self.place_m), 0.0, min(speed_m_s, self.axis.rapid_m_s)
        if way_m < 1e-6:
            return
        if high * self.axis.ramp_s(high) > way_m:
            for _ in range(40):
                middle = 0.5 * (low + high)
                low, high = (middle, high) if middle * self.axis.ramp_s(middle) < way_m else (low, middle)
        peak_m_s, sense = high, math.copysign(1.0, to_m - self.place_m)
        self.ramp(sense * peak_m_s)
        self.hold(max(way_m / peak_m_s - self.axis.ramp_s(peak_m_s), 0.0))
        self.ramp(0.0)
        self.place_m = to_m

    def at(self, time_s: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return places and velocities at some times."""
        start_s, place, velocity, acceleration, jerk = np.array(self.pieces).T
        i = np.maximum(np.searchsorted(start_s, time_s, side="right") - 1, 0)
        t = np.maximum(time_s - start_s[i], 0.0)
        return (
            place[i] + t * (velocity[i] + t * (acceleration[i] / 2.0 + t * jerk[i] / 6.0)),
            velocity[i] + t * (acceleration[i] + t * jerk[i] / 2.0),
        )


def _drill(path: Path, rng: np.random.Generator) -> None:
    """Holes with pecks: fast down, feed, all the way back to break the chip, and a dwell."""
    axis, top_m = path.axis, rng.uniform(path.axis.low_m + 0.1, path.axis.high_m)
    feed_m_s, peck_m = rng.uniform(0.001, 0.05), rng.uniform(0.001, 0.02)
    path.move(top_m, axis.rapid_m_s)
    for _ in range(rng.integers(2, 10)):
        depth_m = 0.0
        for _ in range(rng.integers(1, 8)):
            path.move(top_m - max(depth_m - 0.001, 0.0), axis.rapid_m_s)
            depth_m += peck_m
            path.move(top_m - depth_m, feed_m_s)
            path.move(top_m if rng.random() < 0.7 else top_m - depth_m + 0.001, axis.rapid_m_s)
        path.hold(rng.exponential(1.0))


def _position(path: Path, rng: np.random.Generator) -> None:
    """Short repositions from hole to hole."""
    pitch_m, dwell_s = rng.uniform(0.005, 0.12), rng.exponential(rng.choice([0.05, 0.5, 5.0]))
    for _ in range(rng.integers(3, 30)):
        sense = 1.0 if path.place_m + pitch_m < path.axis.high_m and rng.random() < 0.8 else -1.0
        path.move(path.place_m + sense * pitch_m, path.axis.rapid_m_s)
        path.hold(dwell_s * rng.uniform(0.9, 1.1))


def _contour(path: Path, rng: np.random.Generator) -> None:
    """Changes of velocity without a stop, reversals among them."""
    axis, feed_m_s = path.axis, min(rng.uniform(0.01, 0.5), path.axis.rapid_m_s)
    for _ in range(rng.integers(5, 60)):
        velocity_m_s, seconds = rng.uniform(-feed_m_s, feed_m_s), rng.exponential(0.3)
        ahead_m = path.place_m + velocity_m_s * (seconds + 0.5) + 0.5 * path.velocity_m_s
        if not axis.low_m + 0.05 < ahead_m < axis.high_m - 0.05:
            velocity_m_s = math.copysign(velocity_m_s, 0.5 * (axis.low_m + axis.high_m) - path.place_m)
            seconds = min(seconds, 0.2)
        path.ramp(velocity_m_s)
        path.hold(seconds)
    path.ramp(0.0)


def _change_tool(path: Path, rng: np.random.Generator) -> None:
    """Up to the end of the travel, a dwell, and back."""
    back_m = path.place_m
    path.move(path.axis.high_m, path.axis.rapid_m_s)
    path.hold(rng.uniform(2.0, 8.0))
    path.move(back_m, path.axis.rapid_m_s)


def _jog(path: Path, rng: np.random.Generator) -> None:
    """By hand: many small steps, and runs of any speed."""
    for _ in range(rng.integers(3, 30)):
        step_m = float(rng.choice([1e-5, 1e-4, 1e-3, 0.01, 0.1])) * rng.choice([-1.0, 1.0])
        path.move(path.place_m + step_m, rng.uniform(0.01, 1.0) * path.axis.rapid_m_s)
        path.hold(rng.exponential(0.3))


def _traverse(path: Path, rng: np.random.Generator) -> None:
    """To and fro over much of the travel."""
    speed_m_s, dwell_s = rng.uniform(0.1, 1.0) * path.axis.rapid_m_s, rng.choice([0.0, 0.1, 1.0])
    low_m = rng.uniform(path.axis.low_m, path.axis.low_m + 0.1)
    for _ in range(rng.integers(2, 20)):
        path.move(path.axis.high_m - 0.01, speed_m_s)
        path.hold(dwell_s)
        path.move(low_m, speed_m_s)
        path.hold(dwell_s)


def _rest(path: Path, rng: np.random.Generator) -> None:
    path.hold(rng.exponential(60.0))


PROGRAMMES = (_drill, _position, _contour, _change_tool, _jog, _traverse, _rest)


def draw_path(axis: Axis, seconds: float, rng: np.random.Generator) -> Path:
    """Let an axis work for some time."""
    path = Path(axis, rng.uniform(axis.low_m, axis.high_m))
    while path.time_s < seconds:
        PROGRAMMES[rng.integers(len(PROGRAMMES))](path, rng)
    return path
