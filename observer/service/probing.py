"""The advice to probe, given when the thermal error is too uncertain for the part."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from observer.config.machine import Config
from observer.estimators.design.probing import probing_worth
from observer.frames import EstimateBlock, EstimateQuality, FloatArray
from observer.model.plant import Plant
from observer.service.observers import Step, StepObserver

PERIOD_S = 5.0  # no more often is a bound worked out


def is_advised(config: Config) -> bool:
    """Whether probing can be advised: there is a probe, and the part's need is configured."""
    moved = any(sensor.kind == "displacement" for sensor in config.sensor)
    return moved and config.needs_um is not None


class ProbingAdvisor(StepObserver):
    """Publishes every five seconds whether to probe now, and the gain in σ.

    Args:
        config: A configuration for which `is_advised` holds.
        plant: Its plant.
        instance: Names the start of the service.
        publish: Publishes the document of `probing`.
    """

    def __init__(
        self, config: Config, plant: Plant, instance: str, publish: Callable[[Mapping[str, Any]], None]
    ) -> None:
        self._plant, self._instance, self._publish = plant, instance, publish
        self._needs_um = config.needs_um or math.inf
        self._sensor = next(i for i, s in enumerate(config.sensor) if s.kind == "displacement")
        self._looked_s = -math.inf

    def follow(self, step: Step) -> None:
        """Take a step of the loop; without an estimate nothing is published."""
        if step.now_s - self._looked_s < PERIOD_S:
            return
        snapshot = step.snapshot()
        if snapshot is None or not snapshot.estimator.started:
            return
        self._looked_s = step.now_s
        recommendation = advice(
            self._plant, snapshot.estimator.P, self._sensor, step.estimate, self._needs_um
        )
        self._publish(recommendation | {"sequence": step.sequence, "instance": self._instance})


def advice(
    plant: Plant, P: FloatArray, sensor: int, estimate: EstimateBlock, needs_um: float
) -> dict[str, Any]:
    """Return the document of `probing` for the last step of an estimate.

    The thermal error is known to within its bound, or to 2 σ where no bound is known; probing reduces that by
    the same factor as σ.

    Args:
        plant: The plant.
        P: The covariance of its states, (n, n).
        sensor: The index of the probe among the sensors.
        estimate: Estimates, of which the last one counts.
        needs_um: The uncertainty that the part allows, in µm.

    Returns:
        Plain data: the advice, the place in m where the error is least certain, and its uncertainty in µm
        before and after a probing.
    """
    sigma_um, bound_um = estimate.error_sigma_um[-1], estimate.error_bound_um[-1]
    within_um = np.where(np.isfinite(bound_um), bound_um, 2.0 * sigma_um)
    worth = probing_worth(plant, P, sensor)
    after_um = within_um * worth.after_um / np.maximum(worth.before_um, 1e-12)
    worst = int(np.argmax(within_um))
    return {
        "time_s": float(estimate.time_s[-1]),
        "probe_now": bool(within_um[worst] > needs_um),
        "sensor": plant.layout.sensors[sensor],
        "needs_um": needs_um,
        "position_m": float(plant.layout.position_m[worst]),
        "within_um": round(float(within_um[worst]), 3),
        "after_um": round(float(after_um.max()), 3),
        "quality": EstimateQuality(int(estimate.quality[-1])).label,
    }
