"""A body that is tied tightly to a short rod: the step of a prediction does not matter."""

from dataclasses import replace

import numpy as np
import pytest

from observer.align.aligner import AlignPlan, frames_of_log
from observer.installation import parse
from observer.model.build import build_plant
from observer.model.drive import Drive
from observer.model.simulate import simulate, start
from tests.truth.heated_rod import Rod, configuration, draw, logged

CAPACITY_J_K = 127.0


def predicted(rod: Rod, conductance_W_K: float, row_s: float) -> np.ndarray:
    """What the rod's sensors read after ten minutes of heating, by a prediction in steps of some length."""
    import tomllib
    from pathlib import Path

    from observer.files.logs import Log
    from tests.truth.heated_rod import CHANNELS

    effect = {"kind": "attached_mass", "target": "left"}
    effect |= {"capacity_J_K": CAPACITY_J_K, "conductance_W_K": conductance_W_K}
    config = parse(tomllib.loads(configuration(rod)) | {"effect": [effect]})
    time_s, values = logged(replace(rod, row_s=row_s), 2)
    plant = build_plant(config)
    [frames] = frames_of_log(Log(Path("rod.csv"), time_s, CHANNELS, values), AlignPlan.of(config))
    drive = Drive(config, plant)
    inputs = drive.run(drive.initial(), frames)[1]
    rows = simulate(plant, start(plant, rod.air_degC, inputs.law_W[0]), inputs)[1]
    return rows[-1, plant.rows.sensor_slice]


@pytest.mark.parametrize("conductance_W_K", [5.0, 1000.0])
def test_coarse_steps_predict_what_fine_ones_do(conductance_W_K: float) -> None:
    rod = replace(draw(2, "block"), late_s=0.0, lasts_s=600.0)
    coarse, fine = (predicted(rod, conductance_W_K, row_s) for row_s in (10.0, 0.5))
    rise_K = np.abs(fine - rod.air_degC).max()
    assert rise_K > 10.0
    # second order in the part of the way that body and place come together, at most 0.35 in a step
    np.testing.assert_allclose(coarse, fine, atol=0.02 * rise_K)
