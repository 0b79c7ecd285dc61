"""The open-loop prediction as a sum: what the start and the known inputs do, plus each heat law's own share.

The plant is linear in every source's heat, so the prediction for any strength of the laws is a weighted sum
of responses that are simulated once for each value of the parameters that enter otherwise (the film, an
end's contact, the screw's material).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from observer.config import Config
from observer.fit.runs import Run
from observer.frames import FloatArray
from observer.model.build import build_plant
from observer.model.drive import Drive
from observer.model.simulate import SimulationState, simulate, start_from_sensors
from observer.tables.sections import Source, owner


@dataclass(frozen=True, slots=True)
class Response:
    """30 s means of the sensors' rows of one run: `base` (b, s) without heat, `unit` (m, b, s) for laws of
    strength 1.
    """

    base: FloatArray
    unit: FloatArray

    def at(self, strength: FloatArray) -> FloatArray:
        """Return the prediction (b, s) in °C for laws of the given strengths (m,)."""
        return np.asarray(self.base + np.tensordot(strength, self.unit, axes=1))


class Predictor:
    """Predicts the 30 s means of several runs; what was simulated once is kept."""

    def __init__(self, config: Config, runs: Sequence[Run]) -> None:
        """Take the runs; the number of modes is that of the configuration given here, for good."""
        self._runs = runs
        self._modes = len(build_plant(config).mode_index)
        self._kept: dict[str, list[Response]] = {}

    def __call__(self, config: Config) -> list[FloatArray]:
        """Return the prediction (b, s) of each run in °C."""
        unit_config, strength = unit_laws(config)
        lean = _lean(unit_config, self._modes)
        key = lean.digest
        if key not in self._kept:
            self._kept[key] = [respond(lean, run) for run in self._runs]
        return [response.at(strength) for response in self._kept[key]]


def unit_laws(config: Config) -> tuple[Config, FloatArray]:
    """Return the configuration with heat laws of strength 1, and the strengths (m,) it had."""
    sources = [source.model_copy(update=dict.fromkeys(_linear_in(source), 1.0)) for source in config.source]
    strength = [_strength(source, config) for source in config.source]
    return config.model_copy(update={"source": tuple(sources)}), np.array(strength)


def _linear_in(source: Source) -> tuple[str, ...]:
    """The parameters that only multiply a source's law."""
    if source.torque_Nm is not None and source.nut_torque_Nm is None:
        return ("scale", "share", "torque_Nm")
    if source.law in ("torque_Nm", "bearing", "nut_friction"):
        return ("scale", "share")
    if source.heat_W_rpm is not None:
        return ("scale", "heat_W_rpm")
    return ("scale", "heat_ratio") if source.law == "heat_of" else ("scale",)


def _strength(source: Source, config: Config) -> float:
    """What the law of strength 1 is to be multiplied by."""
    if source.law == "heat_of":
        return source.scale / (source.heat_ratio or 1.0) * _strength(owner(source, config.source), config)
    return math.prod(float(getattr(source, key)) for key in _linear_in(source))


def respond(config: Config, run: Run) -> Response:
    """Simulate one run: without heat, then each source alone."""
    plant = build_plant(config)
    drive = Drive(config, plant)
    inputs = drive.run(drive.initial(), run.frames)[1].sensors_only(plant.rows.sensors)
    plant = plant.sensors_only()
    z = inputs.z_end[0]

    def start_at(law_W: FloatArray) -> SimulationState:
        return start_from_sensors(plant, run.start_degC, run.start_R_K2, law_W, z)

    # sources that effects and links have added keep their laws
    index, count = np.arange(len(plant.source_names)), len(config.source)
    added_W = np.where(index < count, 0.0, inputs.law_W)
    cold = start_at(added_W[0])
    base = run.means(simulate(plant, cold, inputs._replace(law_W=added_W))[1])
    no_z = inputs._replace(z_start=np.zeros_like(inputs.z_start), z_end=np.zeros_like(inputs.z_end))
    unit = np.zeros((count, *base.shape))
    for j in range(count):
        alone = index == j
        if np.any(inputs.law_W[:, j]):
            state = SimulationState(start_at(added_W[0] + np.where(alone, inputs.law_W[0], 0.0)).x - cold.x)
            unit[j] = run.means(simulate(plant, state, no_z._replace(law_W=inputs.law_W * alone))[1])
    return Response(base, unit)


def _lean(config: Config, modes: int) -> Config:
    """The same screw with as few output rows as can be, and, where they are the first ones, a fixed number of
    modes: one more or less from one value of the film to the next would be a step in the misfit.
    """
    length_m = config.screw.length_m
    table = config.model_dump(exclude_unset=True)
    table["output"] = {"positions_m": (0.0, length_m), "reference_degC": 0.0}
    table["screw"].pop("expansion_1_K", None)
    for section in ("drivers", "supports", "compensation"):
        table.pop(section, None)
    if config.model.criterion == "tail" and config.model.modes is None:
        table["model"] = {**table.get("model", {}), "modes": modes}
    return config.remade(table)
