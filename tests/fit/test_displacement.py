"""What displacements let a calibration find on Kuznetsov's rod: expansion, stiffness, pre-tension, play."""

from __future__ import annotations

import tomllib
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from observer.align.aligner import AlignPlan, frames_of_log
from observer.config import Config
from observer.files.logs import Log
from observer.fit.calibrate import Calibration, calibrate
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
CONFIG = """
[screw]
length_m = 1.0
diameter_m = 0.036
conductivity_W_mK = 50.0
density_kg_m3 = 7800.0
specific_heat_J_kgK = 460.0
expansion_1_K = 11.0e-6
[surface]
convection_W_m2K = 15.0
[ambient]
temperature_degC = 20.0
[tolerance]
position_m = 0.0
offset_K = 0.02
lag_s = 0.0
[supports]
mounting = "L-III"
elastic_modulus_Pa = 2.06e11
stiffness_first_N_m = 1.4e8
stiffness_second_N_m = 5.0e8
"""
CONFIG += "".join(
    f'[[source]]\nname = "{n}"\nshape = "point"\nposition_m = {x}\npower_channel = "{n}_W"\n'
    for n, x in (("left", 0.0), ("right", 1.0))
)
CONFIG += "".join(
    f'[[sensor]]\nname = "t{i}"\nchannel = "t{i}_degC"\nposition_m = {x}\nnoise_K = 0.02\n'
    for i, x in enumerate(WARM_M, 1)
)
CONFIG += "".join(
    f'[[sensor]]\nname = "p{i}"\nkind = "displacement"\nchannel = "p{i}_um"\nposition_m = {x}\n'
    "noise_um = 0.3\nzero_um = 0.5\n"
    for i, x in enumerate(PROBE_M, 1)
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


def found(more: str, free: tuple[str, ...], preload_N: float, gap_m: float) -> Calibration:
    """A calibration that frees these keys."""
    config = Config.model_validate(tomllib.loads(CONFIG + more) | {"calibrate": {"free": free}})
    return calibrate(config, [list(frames_of_log(log(preload_N, gap_m), AlignPlan.of(config)))])


def check(result: Calibration, truth: dict[str, float], share: float) -> None:
    """Every key is found within a share of its truth, which its interval holds."""
    assert result.obstacles == ()
    for one in result.fitted:
        assert one.value == pytest.approx(truth[one.key], rel=share), one
        assert one.ci95[0] <= truth[one.key] <= one.ci95[1], one


EXPANSION, FIRST, SECOND = (
    "screw.expansion_1_K",
    "supports.stiffness_first_N_m",
    "supports.stiffness_second_N_m",
)


def test_expansion_and_stiffness() -> None:
    result = found("", (EXPANSION, FIRST, SECOND), 0.0, 0.0)
    check(result, {EXPANSION: 12.4e-6, FIRST: 2.0e8, SECOND: 3.5e8}, 0.05)


def test_preload_and_play() -> None:
    keys = "supports.preload_N", "supports.gap_m"
    text = CONFIG.replace("= 1.4e8", "= 2.0e8\npreload_N = 1000.0\ngap_m = 25e-6").replace(
        "= 5.0e8", "= 3.5e8"
    )
    config = Config.model_validate(
        tomllib.loads(text.replace("11.0e-6", "12.4e-6")) | {"calibrate": {"free": keys}}
    )
    result = calibrate(config, [list(frames_of_log(log(PRELOAD_N, GAP_M), AlignPlan.of(config)))])
    check(result, {keys[0]: PRELOAD_N, keys[1]: GAP_M}, 0.05)
