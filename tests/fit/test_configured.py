"""Calibrations of a machine that the configuration describes rightly, by finite volumes."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
import tomlkit

from observer import Machine
from tests.logs.machines import SCREW
from tests.truth.bar import Bar, Mesh, nut_share, point_share, shuttle_m, substep_times
from tests.truth.rod import Heat, simulate

PLACES_M = (0.04, 0.12, 0.86, 0.96)
TEXT = tomlkit.dumps(
    {
        "screw": SCREW | {"expansion_1_K": 11.8e-6},
        "surface": {"convection_W_m2K": 15.0},
        "ambient": {"channel": "air_degC"},
        "sensor": [
            {"name": f"t{i}", "channel": f"t{i}_degC", "position_m": x_m, "noise_K": 0.05}
            for i, x_m in enumerate(PLACES_M, 1)
        ],
        "source": [
            {"name": "nut", "shape": "nut", "length_m": 0.08, "stroke_m": [0.15, 0.80], "lead_m": 0.010,
             "position_channel": "x_m", "speed_channel": "n_rpm", "torque_Nm": 0.30, "scale": 1.0},
            {"name": "left", "shape": "point", "position_m": 0.0, "speed_channel": "n_rpm",
             "heat_W_rpm": 0.006},
        ],
    }
)  # fmt: skip
SPEEDS_RPM = (880.0, 290.0, 0.0, 1170.0, 610.0, 0.0, 880.0, 1170.0, 290.0)


@cache
def truth(row_s: int) -> dict[str, np.ndarray]:
    """Three hours, twenty minutes at a speed, with a row every `row_s` (columns of a log)."""
    time_s = np.arange(0.0, 1200.0 * len(SPEEDS_RPM) + 1.0)
    mesh, middle_s = Mesh(1.0, 100), substep_times(time_s, 10)
    edges_s = 1200.0 * np.arange(len(SPEEDS_RPM) + 1)
    gone_m = np.append(0.0, np.cumsum(np.array(SPEEDS_RPM) / 60.0 * 0.01 * 1200.0))

    def place_m(at_s: np.ndarray) -> np.ndarray:
        return shuttle_m(np.interp(at_s, edges_s, gone_m), 0.15, 0.80, 1.0)

    speed_rpm = np.array(SPEEDS_RPM)[np.minimum((time_s / 1200.0).astype(int), len(SPEEDS_RPM) - 1)]
    heats = [
        Heat(nut_share(mesh, 0.08, place_m(middle_s)), 0.30 * speed_rpm[:-1] * 2.0 * np.pi / 60.0),
        Heat(point_share(mesh, 0.0), 0.006 * speed_rpm[:-1]),
    ]
    degC = simulate(Bar(), mesh, time_s, heats, np.array(PLACES_M)).temperature_degC[:, :, 0]
    degC = degC + np.random.default_rng(7).normal(0.0, 0.05, degC.shape)
    columns = {f"t{i + 1}_degC": degC[:, i] for i in range(4)}
    columns |= {"x_m": place_m(time_s), "n_rpm": speed_rpm, "air_degC": np.full(len(time_s), 20.0)}
    return {name: column[::row_s] for name, column in ({"time_s": time_s} | columns).items()}


def test_rows_a_minute_apart_keep_a_nut_whose_way_follows_from_its_speed() -> None:
    found = Machine.of_text(TEXT).calibrate(truth(60)).document
    # a way made up between the rows leaves 1 K and more, and finds next to nothing of the nut's heat; a
    # minute of a switch of speed leaves 0.1 K
    assert found["gap"]["before_rms_K"] < 0.3
    assert found["calibrated"]["source.nut.scale"]["value"] == pytest.approx(1.0, abs=0.15)
    assert list(found["nut_path"].values()) == [{"nut": "undetermined"}]


def test_values_that_leave_a_larger_gap_than_those_configured_are_not_written() -> None:
    machine = Machine.of_text(TEXT)
    found = machine.calibrate(truth(1))
    gap = found.document["gap"]
    assert gap["after_rms_K"] > gap["before_rms_K"]
    assert "the configured values are kept" in found.document["kept"]
    assert found.document["left"] == {}
    assert found.machine.config.surface == machine.config.surface
    assert [s.scale for s in found.machine.config.source] == [1.0, 1.0]


def test_values_that_leave_a_smaller_gap_are_written() -> None:
    off = Machine.of_text(TEXT.replace("torque_Nm = 0.3", "torque_Nm = 0.4"))
    found = off.calibrate(truth(1))
    assert found.document["kept"] is None
    assert found.machine.config.source[0].scale == pytest.approx(0.75, abs=0.05)
