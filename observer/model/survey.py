"""A machine with outputs everywhere: a sensor on every node, and the growth of the unsupported screw.

The displacement between any supports follows from that growth.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from observer.config.machine import Config
from observer.config.sensors import Sensor
from observer.frames import FloatArray
from observer.model.build import build_plant, grid_of
from observer.model.plant import Plant
from observer.model.rod.supports import Restraint, displacement_um, force_N

NODE = "node."
"""Prefix of the name of a survey's sensor on a node."""


CLOSE_STEPS = 200
"""Steps along a screw for its warmest and coldest place: one is 0.5 % of its length."""


class Survey(NamedTuple):
    """A machine's plant with a sensor on each node.

    Attributes:
        config: The configuration with these sensors and without supports.
        plant: Its model. After the grid, its field has close places from end to end.
        grid_m: Grid of the original configuration, m, (g,).
    """

    config: Config
    plant: Plant
    grid_m: FloatArray


class Growth(NamedTuple):
    """Growth of the free screw.

    Attributes:
        along_um: Growth up to each place of the grid, µm, (K, g).
        whole_um: Growth of the whole screw, µm, (K,).
    """

    along_um: FloatArray
    whole_um: FloatArray


def survey_of(config: Config) -> Survey:
    """Return the survey of a configuration, without its probes, which read the thermal error.

    Args:
        config: The machine. Supports are left out, because displacements follow from the free growth.

    Raises:
        ConfigError: If an effect is impossible on this machine.
    """
    warm = tuple(s for s in config.sensor if s.kind == "temperature")
    moved = {s.name for s in config.sensor} - {s.name for s in warm}
    effects = tuple(
        e for e in config.effect if e.targets != "sensor" or getattr(e, "target", None) not in moved
    )
    grid_m, length_m = grid_of(config), config.screw.length_m
    taken = {s.channel for s in config.sensor}
    nodes = tuple(
        Sensor(
            name=NODE + node.name, channel=_free(f"{NODE}{node.name}_degC", taken), on=node.name, noise_K=0.1
        )
        for node in config.node
    )
    # heats that enter at a place leave a peak there
    peaks = {s.position_m for s in config.source if s.position_m is not None}
    close_m = sorted(peaks.union(np.linspace(0.0, length_m, CLOSE_STEPS + 1).tolist()))
    places = (*grid_m.tolist(), *close_m)
    output = config.output.model_copy(update={"positions_m": places})
    surveyed = config.model_copy(
        update={"sensor": (*warm, *nodes), "effect": effects, "supports": None, "output": output}
    )
    return Survey(surveyed, build_plant(surveyed), grid_m)


def _free(name: str, taken: set[str]) -> str:
    return name if name not in taken else _free(name + "_", taken)


def growth_of(survey: Survey, rows: FloatArray) -> Growth | None:
    """Return the free growth in output rows.

    Args:
        survey: The survey.
        rows: Output rows of its plant, (K, R).

    Returns:
        The growth; None without an expansion coefficient.
    """
    along_um = rows[:, survey.plant.rows.error_slice]
    if not along_um.shape[1]:
        return None
    return Growth(along_um[:, : len(survey.grid_m)], along_um[:, -1])


def displaced(restraint: Restraint | None, growth: Growth) -> tuple[FloatArray, FloatArray]:
    """Return thermal error and axial force between supports.

    Args:
        restraint: The supports; None for a free screw.
        growth: Growth of the free screw.

    Returns:
        The error, µm, (K, g), and the force, N, (K,), tension positive.
    """
    error_um = displacement_um(restraint, growth.along_um, growth.whole_um)
    return error_um, np.zeros_like(growth.whole_um) if restraint is None else force_N(
        restraint, growth.whole_um
    )
