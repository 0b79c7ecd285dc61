"""A screw with a bore conducts and stores with what is left of it, and loses heat by its outer surface."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from observer.config.machine import Config
from observer.errors import ConfigError
from observer.installation import parse
from observer.model.build import build_plant
from observer.model.rod.screw import rod_of, surface_rate
from tests.logs.machines import table

BORE_M, DIAMETER_M, LENGTH_M = 0.012, 0.02, 0.4
AREA_M2 = math.pi / 4 * (DIAMETER_M**2 - BORE_M**2)


def bored(**tables: Any) -> Config:
    made = table(**tables)
    return parse(made | {"screw": made["screw"] | {"bore_m": BORE_M, "expansion_1_K": 12e-6}})


def test_the_steady_field_of_a_heat_at_the_end_is_that_of_a_fin_of_the_tubes_section() -> None:
    """T(0) = q/(k A m tanh(m L)), m² = h P/(k A) (Carslaw and Jaeger 1959, §4.5)."""
    end = {"name": "end", "shape": "point", "position_m": 0.0, "power_channel": "end_W"}
    plant = build_plant(bored(source=[end]))
    m_1_m = math.sqrt(20.0 * math.pi * DIAMETER_M / (50.0 * AREA_M2))
    wanted_K_W = 1.0 / (50.0 * AREA_M2 * m_1_m * math.tanh(m_1_m * LENGTH_M))
    field = plant.rows.C[plant.rows.field_slice] @ (plant.B[:, 0] / plant.decay_1_s)
    assert field[0] == pytest.approx(wanted_K_W, rel=1e-9)


def test_the_slowest_mode_loses_what_the_tube_stores() -> None:
    config = bored()
    rate_1_s = 20.0 * math.pi * DIAMETER_M / (7800.0 * 460.0 * AREA_M2)
    assert build_plant(config).decay_1_s[0] == pytest.approx(rate_1_s, rel=1e-12)
    assert 20.0 * surface_rate(config.screw) == pytest.approx(rate_1_s, rel=1e-12)


def test_the_tube_is_softer_between_rigid_supports() -> None:
    held = build_plant(bored(supports={"mounting": "L-III", "preload_N": 1000.0})).rows.restraint
    assert held is not None
    assert held.lost_um == pytest.approx(1e6 * 1000.0 * LENGTH_M / (2.06e11 * AREA_M2))


def test_a_bore_as_wide_as_the_screw_is_refused() -> None:
    made = table()
    with pytest.raises(ConfigError, match="leaves nothing of diameter_m"):
        parse(made | {"screw": made["screw"] | {"bore_m": 0.02}})


def test_without_a_bore_nothing_changes() -> None:
    solid, none = parse(table()), parse(table(screw=table()["screw"] | {"bore_m": 0.0}))
    assert rod_of(solid) == rod_of(none)
    np.testing.assert_array_equal(build_plant(solid).B, build_plant(none).B)
