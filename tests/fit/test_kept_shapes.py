"""A prediction keeps what a nut's path makes of the modes; for other modes it is made anew."""

from pathlib import Path

import numpy as np

from observer.align.aligner import AlignPlan, frames_of_log
from observer.config import Config
from observer.files.logs import Log
from observer.fit.forward import Forward
from observer.fit.runs import prepare
from tests.logs.machines import SCREW, machine

TIME_S = np.arange(0.0, 1800.0)


def stepped(film_W_m2K: float) -> Config:
    """A screw of two diameters whose moving nut is tied to a body: its modes change with the film."""
    section = {"from_m": 0.0, "to_m": 0.15, "diameter_m": 0.012}
    return machine(
        screw=SCREW | {"length_m": 0.4, "diameter_m": 0.02, "section": [section]},
        surface={"convection_W_m2K": film_W_m2K},
        node=[{"name": "body", "capacity_J_K": 400.0}],
        link=[
            {"between": ["body", "nut"], "conductance_W_K": 8.0},
            {"between": ["body", "ambient"], "conductance_W_K": 0.5},
        ],
        source=[
            {"name": "nut", "shape": "nut", "length_m": 0.05, "stroke_m": [0.08, 0.32],
             "position_channel": "x_m", "speed_channel": "n_rpm", "torque_Nm": 0.3},
        ],
    )  # fmt: skip


def forward(config: Config) -> Forward:
    columns = {s.channel: np.full_like(TIME_S, 20.0) for s in config.sensor}
    columns |= {"n_rpm": np.full_like(TIME_S, 1000.0), "x_m": 0.2 + 0.12 * np.sin(2 * np.pi * TIME_S / 40.0)}
    log = Log(Path("run.csv"), TIME_S, tuple(columns), np.column_stack(list(columns.values())))
    return Forward(config, [prepare(config, list(frames_of_log(log, AlignPlan.of(config))), "log")])


def test_a_screw_with_sections_is_predicted_alike_after_other_films() -> None:
    before, after = stepped(20.0), stepped(40.0)
    used, unused = forward(before), forward(before)
    used(before)
    # both share the lag's tables of the first film; shapes of its modes would be 4.6 K off
    np.testing.assert_allclose(used(after)[0], unused(after)[0], atol=1e-3)
