"""What displacements let a calibration find on Kuznetsov's rod: expansion, stiffness, pre-tension, play."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np
import pytest

from observer.align.aligner import AlignPlan, frames_of_log
from observer.config.machine import Config
from observer.files.logs import Log
from observer.fit.calibrate import calibrate
from tests.logs.machines import SCREW, machine
from tests.truth.bar import Bar
from tests.truth.kuznetsov import displacement_um, field

BAR = Bar(expansion_1_K=12.4e-6)
HEATS_W, MODULUS_PA = (40.0, 25.0), 2.06e11
STIFFNESS_N_M, PRELOAD_N, GAP_M = (2.0e8, 3.5e8), 2500.0, 12e-6
WARM_M, PROBE_M = np.array([0.1, 0.5, 0.9]), np.array([0.3, 0.6, 0.95])
TIMES_S = np.arange(0.0, 6000.0, 30.0)
FROM_S = 285.0
"""When both heats go on, half-way between two rows."""
CHANNELS = ("t1_degC", "t2_degC", "t3_degC", "p1_um", "p2_um", "p3_um", "left_W", "right_W")
SUPPORTS = {
    "mounting": "L-III", "elastic_modulus_Pa": MODULUS_PA, "stiffness_first_N_m": 1.4e8,
    "stiffness_second_N_m": 5.0e8,
}  # fmt: skip
SENSORS = [
    {"name": f"t{i}", "channel": f"t{i}_degC", "position_m": x_m, "noise_K": 0.02}
    for i, x_m in enumerate(WARM_M, 1)
] + [
    {"name": f"p{i}", "kind": "displacement", "channel": f"p{i}_um", "position_m": x_m, "noise_um": 0.3,
     "zero_um": 0.5}
    for i, x_m in enumerate(PROBE_M, 1)
]  # fmt: skip
SOURCES = [
    {"name": name, "shape": "point", "position_m": x_m, "power_channel": f"{name}_W"}
    for name, x_m in (("left", 0.0), ("right", 1.0))
]


def rod(expansion_1_K: float, free: tuple[str, ...], **supports: float) -> Config:
    """Kuznetsov's rod as a configuration has it, with a wrong expansion, stiffness, pre-tension or play."""
    return machine(
        screw=SCREW | {"expansion_1_K": expansion_1_K},
        surface={"convection_W_m2K": 15.0},
        tolerance={"position_m": 0.0, "offset_K": 0.02, "lag_s": 0.0},
        supports=SUPPORTS | supports,
        source=SOURCES,
        sensor=SENSORS,
        calibrate={"free": free},
    )


@cache
def log(preload_N: float, gap_m: float) -> Log:
    """A hundred minutes, of which both ends are heated nearly all, from the closed form."""
    rng = np.random.default_rng(26)
    rows = np.zeros((len(TIMES_S), 8))
    rows[:, :3] = 20.0
    for k in np.flatnonzero(TIMES_S > FROM_S).tolist():
        time_s = float(TIMES_S[k] - FROM_S)
        rows[k, 6:] = HEATS_W
        rows[k, :3] += field(BAR, *HEATS_W, WARM_M, time_s)
        rows[k, 3:6] = displacement_um(
            BAR, HEATS_W, STIFFNESS_N_M, MODULUS_PA, preload_N, gap_m, PROBE_M, time_s
        )
    rows[:, :3] += 0.02 * rng.standard_normal((len(rows), 3))
    rows[:, 3:6] += 0.3 * rng.standard_normal((len(rows), 3))
    return Log(Path("rod.csv"), TIMES_S, CHANNELS, rows)


@pytest.mark.parametrize(
    ("configured", "preload_N", "gap_m", "truth"),
    [
        ({"expansion_1_K": 11.0e-6}, 0.0, 0.0, {
            "screw.expansion_1_K": 12.4e-6, "supports.stiffness_first_N_m": 2.0e8,
            "supports.stiffness_second_N_m": 3.5e8,
        }),
        (
            {"expansion_1_K": 12.4e-6, "stiffness_first_N_m": 2.0e8, "stiffness_second_N_m": 3.5e8,
             "preload_N": 1000.0, "gap_m": 25e-6},
            PRELOAD_N, GAP_M, {"supports.preload_N": PRELOAD_N, "supports.gap_m": GAP_M},
        ),
    ],
    ids=["expansion and stiffness", "preload and play"],
)  # fmt: skip
def test_displacements_let_a_calibration_find_what_moves_a_rod(
    configured: dict[str, float], preload_N: float, gap_m: float, truth: dict[str, float]
) -> None:
    config = rod(free=tuple(truth), **configured)
    result = calibrate(config, [list(frames_of_log(log(preload_N, gap_m), AlignPlan.of(config)))])
    assert result.obstacles == ()
    for one in result.fitted:
        assert one.value == pytest.approx(truth[one.key], rel=0.05), one
        assert one.ci95[0] <= truth[one.key] <= one.ci95[1], one
