"""A surveyed machine: the error between supports from the growth of the free screw, and every node."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from observer.config.machine import Config
from observer.model.build import build_plant, restraint_on
from observer.model.settle import point_of, settled
from observer.model.survey import displaced, growth_of, survey_of
from tests.reference.cases import config_of, point
from tests.truth.bar import Bar

BAR = Bar(length_m=0.6, diameter_m=0.03, convection_W_m2K=12.0)
GRID_M = np.array([0.0, 0.2, 0.5])
VALUES = {"left_W": 6.0, "right_W": 9.0, "ambient_degC": 22.0}
STIFF = {"mounting": "L-III", "stiffness_first_N_m": 2e8, "stiffness_second_N_m": 1e8}


def described(**tables: Any) -> Config:
    """Two heats, a housing that the left one warms, a bed, and what is asked for."""
    house = {
        "node": [{"name": "house", "capacity_J_K": 900.0}],
        "link": [
            {"between": ["house", "left"], "conductance_W_K": 0.4},
            {"between": ["house", "ambient"], "conductance_W_K": 0.2},
        ],
        "bed": {"expansion_1_K": 9e-6, "on": "house"},
    }
    both = [point("left", 0.0), point("right", BAR.length_m)]
    return config_of(BAR, both, GRID_M, **(house | tables))


@pytest.mark.parametrize("more", [{}, {"preload_N": 500.0}, {"preload_N": 500.0, "gap_m": 1e-5}])
def test_the_error_between_supports_follows_from_the_free_growth(more: dict[str, float]) -> None:
    config = described(supports=STIFF | more)
    plant = build_plant(config)
    whole = plant.rows.error_um(settled(plant, point_of(config, plant, VALUES)).rows[None])[0]

    survey = survey_of(config)
    rows = settled(survey.plant, point_of(survey.config, survey.plant, VALUES)).rows[None]
    growth = growth_of(survey, rows)
    assert growth is not None
    error_um, force_N = displaced(restraint_on(config, survey.grid_m), growth)
    np.testing.assert_allclose(error_um[0], whole, rtol=0, atol=1e-9)
    assert force_N[0] < more.get("preload_N", 0.0)


def test_every_node_is_read_beside_the_sensors() -> None:
    survey = survey_of(described())
    rows = settled(survey.plant, point_of(survey.config, survey.plant, VALUES)).rows
    assert [s.name for s in survey.config.sensor] == ["t1", "node.house"]
    screw_W = 0.4 * (rows[survey.plant.rows.field_slice][0] - rows[1])
    assert screw_W == pytest.approx(0.2 * (rows[1] - 22.0), rel=1e-9)


def test_a_probe_is_no_temperature_of_a_survey() -> None:
    probe = {"name": "p", "kind": "displacement", "channel": "p_um", "position_m": 0.5}
    thermocouple = {"name": "t1", "channel": "t1_degC", "position_m": 0.2}
    survey = survey_of(described(supports=STIFF, sensor=[probe, thermocouple]))
    assert [s.name for s in survey.config.sensor] == ["t1", "node.house"]
    rows = settled(survey.plant, point_of(survey.config, survey.plant, VALUES)).rows
    assert rows[0] == pytest.approx(rows[survey.plant.rows.field_slice][1], abs=1e-9)
