"""With the real drive and estimators, too, the replay of a recording is the live run to the last bit."""

import math
from dataclasses import fields

import numpy as np
import pytest

from observer.align.aligner import Aligner, AlignPlan, frames_of_log
from observer.estimate.pipeline import Pipeline
from observer.estimators import build_estimator
from observer.files.logs import read_log
from observer.frames import EstimateBlock, Reading
from observer.installation import parse
from observer.model.build import build_plant
from observer.model.drive import Drive
from tests.logs.recordings import play, write

POSITIONS_M = (0.05, 0.28, 0.5, 0.72, 0.95)
TABLE = {
    "screw": {"length_m": 1.0, "diameter_m": 0.036, "conductivity_W_mK": 50.0, "density_kg_m3": 7800.0,
              "specific_heat_J_kgK": 460.0, "expansion_1_K": 11.8e-6},
    "surface": {"convection_W_m2K": 15.0},
    "ambient": {"channel": "ambient_degC"},
    "source": [
        {"name": "nut", "shape": "nut", "length_m": 0.08, "stroke_m": [0.2, 0.8], "torque_Nm": 0.3,
         "share": 0.5, "position_channel": "nut_position_m", "speed_channel": "screw_speed_rpm"},
        {"name": "bearing", "shape": "point", "position_m": 0.0, "speed_channel": "screw_speed_rpm",
         "heat_W_rpm": 0.006},
    ],
    "sensor": [{"name": f"t{i}", "channel": f"t{i}_degC", "position_m": x_m, "noise_K": 0.05}
               for i, x_m in enumerate(POSITIONS_M)],
}  # fmt: skip


def _events(ticks: int) -> list[Reading | float]:
    """Seconds after the event before, as `play` takes them: uneven ticks, faults, a late channel."""
    rng = np.random.default_rng(11)
    events: list[Reading | float] = []
    for k in range(ticks):
        for j in range(5):
            moving = {"nut_position_m": 0.5 + 0.3 * math.sin(0.3 * k + 0.06 * j)}
            if k > 3:
                moving["screw_speed_rpm"] = 1500.0 if k % 40 > 10 else 0.0
            events.append(Reading(0.07, moving))
        values = {f"t{i}_degC": 22 + rng.normal(0, 0.05) + 0.002 * k for i in range(5)}
        faults = {"t2_degC": "open_circuit"} if k % 11 == 3 else {}
        if k % 3:
            values["ambient_degC"] = 22 + rng.normal(0, 0.01)
        events += [Reading(0.05, values, faults), rng.uniform(0.01, 0.2)]
    return events


@pytest.mark.parametrize("effect", [[], [{"kind": "natural_convection", "coefficient_W_m2K": 8.0}]])
@pytest.mark.parametrize(
    "estimator", [{"kind": "kalman"}, {"kind": "kalman", "engine": "constant"}, {"kind": "luenberger"}]
)
def test_replay_is_the_live_run_to_the_last_bit(tmp_path, estimator, effect):
    config = parse(TABLE | {"estimator": {**estimator, "period_s": 0.5}, "effect": effect})
    plant = build_plant(config)
    plan, drive, built = AlignPlan.of(config), Drive(config, plant), build_estimator(plant, config.estimator)
    frames, recording = play(_events(150), Aligner(plan), plan.channels)
    live, replay = Pipeline(drive, built), Pipeline(drive, built)
    log = read_log(write(tmp_path, recording), plan.channels)
    one = [live.step(frame) for frame in frames]
    other = [replay.step(block) for block in frames_of_log(log, plan, 37)]
    for name in (field.name for field in fields(EstimateBlock)):
        a, b = (np.concatenate([getattr(block, name) for block in blocks]) for blocks in (one, other))
        assert a.tobytes() == b.tobytes(), name
    assert np.isfinite(one[-1].heat_W).all()
