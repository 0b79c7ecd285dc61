"""Things that no effect of the library explains: when and where they happen is drawn and recorded as fact."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from tests.truth.machine.effects import Effect
from tests.truth.machine.grid import point_share
from tests.truth.machine.machine import SENSORS, Machine
from tests.truth.machine.physics import FloatArray, Schedule

HOUR_s = 3600.0


@dataclass(frozen=True)
class Scene:
    """One run before it is run: the machine, its steps, and how well each sensor touches the screw.

    `contact` (K + 1, 5): 1 reads the screw, 0 the air.
    """

    machine: Machine
    schedule: Schedule
    contact: FloatArray

    @property
    def duration_s(self) -> float:
        """How long the run lasts."""
        return len(self.schedule.speed_rpm) * self.schedule.step_s

    def during(self, from_s: float, to_s: float) -> np.ndarray:
        """The steps of a stretch of time, (K,)."""
        time_s = (np.arange(len(self.schedule.speed_rpm)) + 0.5) * self.schedule.step_s
        return np.asarray((time_s >= from_s) & (time_s < to_s))


Facts = dict[str, float | str]


def _film_hour(scene: Scene, effect: Effect, _rng: np.random.Generator) -> tuple[Scene, list[Facts]]:
    """The base film is another for the hour in the middle of the run: a door stands open."""
    from_s = 0.5 * (scene.duration_s - HOUR_s)
    factor = np.where(scene.during(from_s, from_s + HOUR_s), effect["factor"], 1.0)
    facts: list[Facts] = [{"from_s": from_s, "to_s": from_s + HOUR_s}]
    return _scheduled(scene, film_factor=factor), facts


def _heat_burst(scene: Scene, effect: Effect, rng: np.random.Generator) -> tuple[Scene, list[Facts]]:
    """A heat at one place for 5 to 10 minutes: hot chips."""
    from_s = float(rng.uniform(0.15, 0.85) * scene.duration_s)
    to_s = from_s + float(rng.uniform(300.0, 600.0))
    physics = scene.machine.physics._replace(spot=point_share(scene.machine.grid, effect["position_m"]))
    scene = dataclasses.replace(scene, machine=dataclasses.replace(scene.machine, physics=physics))
    spot_W = np.where(scene.during(from_s, to_s), effect["heat_W"], 0.0)
    return _scheduled(scene, spot_W=spot_W), [{"from_s": from_s, "to_s": to_s}]


def _stick_slip(scene: Scene, effect: Effect, rng: np.random.Generator) -> tuple[Scene, list[Facts]]:
    """The nut rubs harder in episodes, only upward and only on the upper half of its stroke.

    Over a whole stroke one direction alone would average out and look like more torque.
    """
    factor, facts = np.ones(len(scene.schedule.speed_rpm)), list[Facts]()
    turning_s = np.flatnonzero(scene.schedule.speed_rpm) * scene.schedule.step_s
    for third in np.array_split(turning_s, 3):
        length_s = float(rng.uniform(480.0, 900.0))
        from_s = float(rng.choice(third[third <= third[-1] - 0.5 * length_s]))
        factor[scene.during(from_s, from_s + length_s)] = effect["factor"]
        facts.append({"from_s": from_s, "to_s": from_s + length_s})
    return _scheduled(scene, climb_factor=factor), facts


def _grease_step(scene: Scene, effect: Effect, rng: np.random.Generator) -> tuple[Scene, list[Facts]]:
    """The nut is greased in the middle of a run: its friction is another from then on."""
    turning_s = np.flatnonzero(scene.schedule.speed_rpm) * scene.schedule.step_s
    from_s = float(np.quantile(turning_s, rng.uniform(0.3, 0.7)))
    factor = np.where(scene.during(from_s, scene.duration_s), effect["factor"], 1.0)
    return _scheduled(scene, nut_factor=factor), [{"from_s": from_s, "to_s": scene.duration_s}]


def _loose_sensor(scene: Scene, effect: Effect, rng: np.random.Generator) -> tuple[Scene, list[Facts]]:
    """A sensor lifts off for 40 minutes while the screw is warm, and reads partly the air."""
    from_s = float(rng.uniform(0.3, 0.55) * scene.duration_s)
    time_s = np.arange(len(scene.contact)) * scene.schedule.step_s
    contact = scene.contact.copy()
    loose = (time_s >= from_s) & (time_s < from_s + 2400.0)
    contact[loose, SENSORS.index(str(effect.target))] = effect["contact"]
    return dataclasses.replace(scene, contact=contact), [{"from_s": from_s, "to_s": from_s + 2400.0}]


def _scheduled(scene: Scene, **changes: Any) -> Scene:
    return dataclasses.replace(scene, schedule=scene.schedule._replace(**changes))


OUTSIDE: dict[str, Callable[[Scene, Effect, np.random.Generator], tuple[Scene, list[Facts]]]] = {
    "film_hour": _film_hour,
    "heat_burst": _heat_burst,
    "stick_slip": _stick_slip,
    "grease_step": _grease_step,
    "loose_sensor": _loose_sensor,
}
