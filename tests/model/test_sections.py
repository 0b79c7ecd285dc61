"""A screw's sections in its configuration, and what holds it between supports."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from observer import installation
from observer.config.machine import Config
from observer.errors import ConfigError
from observer.estimators.design.steady import gain_for, standing_growth_1_s
from observer.installation import parse
from observer.model.build import build_plant
from observer.model.discretise import step_matrices
from tests.logs.machines import table
from tests.reference.stepped_cases import SLIDES


def cut(*sections: dict[str, float], **of_screw: Any) -> Config:
    """The small bar of 0.4 m and 20 mm with sections."""
    made = table()
    own = made["screw"] | {"section": list(sections), "expansion_1_K": 12e-6}
    return parse(made | {"screw": own} | of_screw)


@pytest.mark.parametrize(
    ("sections", "said"),
    [
        ([{"from_m": 0.1, "to_m": 0.2}], "section 0.1 … 0.2 m has nothing of its own"),
        ([{"from_m": 0.2, "to_m": 0.1, "diameter_m": 0.01}], "is empty"),
        ([{"from_m": 0.3, "to_m": 0.5, "diameter_m": 0.01}], "leaves the screw, length_m = 0.4"),
        (
            [{"from_m": 0.0, "to_m": 0.2, "bore_m": 0.01}, {"from_m": 0.1, "to_m": 0.3, "bore_m": 0.01}],
            "section 0.1 … 0.3 m overlaps the one before it, which ends at 0.2 m",
        ),
        ([{"from_m": 0.1, "to_m": 0.2, "bore_m": 0.02}], "bore_m = 0.02 leaves nothing of diameter_m = 0.02"),
    ],
)
def test_sections_that_cannot_be_are_refused_in_a_sentence(sections: list[Any], said: str) -> None:
    with pytest.raises(ConfigError, match=said):
        cut(*sections)


def test_sections_like_the_screw_change_no_bit() -> None:
    plain, same = cut(), cut({"from_m": 0.1, "to_m": 0.25, "diameter_m": 0.02, "bore_m": 0.0})
    np.testing.assert_array_equal(build_plant(plain).B, build_plant(same).B)
    np.testing.assert_array_equal(build_plant(plain).rows.C, build_plant(same).rows.C)


def test_between_supports_sections_are_springs_in_series() -> None:
    """A journal of half the diameter over a quarter of the length: 1/A of 0.75 + 0.25 · 4 of the screw's."""
    held = cut(
        {"from_m": 0.0, "to_m": 0.1, "diameter_m": 0.01},
        supports={"mounting": "L-III", "preload_N": 1000.0},
        output={"positions_m": [0.0, 0.1, 0.25, 0.4]},
    )
    restraint = build_plant(held).rows.restraint
    assert restraint is not None
    softer = 0.75 + 0.25 * 4.0
    area_m2 = math.pi / 4.0 * 0.02**2
    assert restraint.lost_um == pytest.approx(1e6 * 1000.0 * 0.4 * softer / (2.06e11 * area_m2))
    assert restraint.hold == pytest.approx([0.0, 1.0 / softer, (1.0 + 0.375) / softer, 1.0])


def test_a_constant_gain_serves_two_nuts_wherever_each_stands_on_its_own_stroke() -> None:
    config = installation.load(SLIDES)
    plant = build_plant(config)
    step = step_matrices(plant, config.estimator.period_s)
    slow = replace(plant, noise_R_K2=1e4 * plant.noise_R_K2)  # as cautious as an export
    gain = gain_for(slow, step, np.ones(plant.rows.sensors, dtype=np.bool_), config.estimator, None)
    assert isinstance(gain, np.ndarray)
    assert standing_growth_1_s(plant, step, gain) <= 1e-5
