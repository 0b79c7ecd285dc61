"""A bed, table or scale that expands too: the thermal error is that between tool and workpiece."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from observer.config.machine import Config
from observer.errors import ConfigError
from observer.frames import FloatArray
from observer.installation import parse
from observer.model.build import build_plant
from observer.model.drive import Drive
from tests.logs.machines import table
from tests.logs.simulated import frames

STEEL_1_K, CAST_1_K = 11.8e-6, 9.0e-6
BED = {"expansion_1_K": CAST_1_K, "channel": "bed_degC"}
SUPPORTS = {"mounting": "L-III", "stiffness_first_N_m": 3e8, "stiffness_second_N_m": 2e8}


def machine(**tables: Any) -> Config:
    made = table(**tables)
    screw = made["screw"] | {"expansion_1_K": STEEL_1_K}
    return parse(made | {"screw": screw, "output": {"reference_degC": 20.0}})


def error_um(config: Config, screw_degC: float, bed_degC: float) -> FloatArray:
    """The error on the grid of a screw of one temperature on a bed of another."""
    plant = build_plant(config)
    columns = {name: np.full(2, 20.0) for name in config.channels}
    columns |= {"bed_degC": np.full(2, bed_degC)}
    drive = Drive(config, plant)
    _, u = drive.run(drive.initial(), frames(config, np.array([0.0, 1.0]), columns))
    state = np.where(np.arange(len(plant.decay_1_s)) < plant.modes, screw_degC * plant.uniform, 0.0)
    air_degC = u.z_end[:1].copy()
    air_degC[0, plant.known.ambient] = screw_degC  # at rest with its air, so that no dropped mode has a part
    return plant.rows.error_um(state[None] @ plant.rows.C.T + air_degC @ plant.rows.F.T)[0]


def test_without_supports_each_grows_by_its_own_coefficient() -> None:
    config = machine(bed=BED)
    x_m = np.linspace(0.0, 0.4, 21)
    wanted = 1e6 * x_m * (STEEL_1_K * 12.0 - CAST_1_K * 7.0)
    # the kept modes of a uniform field have digits, no more
    np.testing.assert_allclose(error_um(config, 32.0, 27.0), wanted, atol=1e-6)


def test_supports_that_move_with_the_bed_pull_and_push_as_springs_do() -> None:
    """The balance of two springs and a screw whose ends sit on a bed that has grown as well."""
    held = error_um(machine(bed=BED, supports=SUPPORTS), 32.0, 27.0)
    screw_N_m = 2.06e11 * math.pi * 0.02**2 / 4 / 0.4
    free_m = 0.4 * (STEEL_1_K * 12.0 - CAST_1_K * 7.0)
    force_N = -free_m / (1 / 3e8 + 1 / screw_N_m + 1 / 2e8)
    # the left end gives by N/j_1 towards the bed's left, the right one by N/j_2 the other way
    np.testing.assert_allclose(held[[0, -1]], 1e6 * np.array([force_N / 3e8, -force_N / 2e8]), atol=1e-6)


def test_a_bed_of_the_screws_own_kind_and_temperature_leaves_no_error() -> None:
    alike = BED | {"expansion_1_K": STEEL_1_K}
    for supports in (
        {},
        {"supports": SUPPORTS},
        {"supports": SUPPORTS | {"gap_m": 2e-6, "preload_N": 500.0}},
    ):
        np.testing.assert_allclose(error_um(machine(bed=alike, **supports), 29.0, 29.0), 0.0, atol=1e-6)


def test_a_bed_that_is_a_node_is_estimated_with_the_others() -> None:
    """The same error from the state of a node as from a channel that measures it."""
    node = {"name": "bed", "capacity_J_K": 8000.0}
    link = {"between": ["bed", "ambient"], "conductance_W_K": 2.0}
    config = machine(bed={"expansion_1_K": CAST_1_K, "on": "bed"}, node=[node], link=[link])
    plant = build_plant(config)
    grown_um = plant.rows.C[plant.rows.error_slice, -1]  # of a bed that is a kelvin warmer, and nothing else
    np.testing.assert_allclose(grown_um, -1e6 * CAST_1_K * np.linspace(0.0, 0.4, 21), atol=1e-9)


def test_a_bed_needs_a_place_for_its_temperature() -> None:
    with pytest.raises(ConfigError, match='bed: on names "table", which is no node'):
        machine(bed={"expansion_1_K": CAST_1_K, "on": "table"})
    with pytest.raises(ConfigError, match="channel"):
        machine(bed={"expansion_1_K": CAST_1_K})
    with pytest.raises(ConfigError, match="bed needs the screw's expansion coefficient"):
        parse(table(bed=BED))
