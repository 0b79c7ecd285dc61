"""Calibrations from logs with doubtful parts, and those that would make a prediction worse."""

from __future__ import annotations

import csv
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from observer import LogError, Machine
from observer.cli import app
from tests.fit.test_configured import TEXT, truth

OFF = TEXT.replace("torque_Nm = 0.3", "torque_Nm = 0.4")


def log_with(**changes: np.ndarray) -> dict[str, np.ndarray]:
    """The log of a machine whose nut has three quarters of the configured friction, with other columns."""
    return truth(1) | changes


@cache
def nut_scale_of_the_whole_log() -> float:
    return Machine.of_text(OFF).calibrate(truth(1)).values["source.nut.scale"].value


def test_rows_without_a_position_are_left_out_and_reported() -> None:
    log = truth(1)
    lost = (log["time_s"] >= 3000.0) & (log["time_s"] < 3600.0)
    result = Machine.of_text(OFF).calibrate(log_with(x_m=np.where(lost, np.nan, log["x_m"])))
    [sentence] = result.document["left_out"]
    assert "600 s of 10800 s are left out, because x_m could not be trusted" in sentence
    assert result.values["source.nut.scale"].value == pytest.approx(nut_scale_of_the_whole_log(), abs=0.05)


def test_a_sensor_that_comes_off_is_left_out_and_moves_no_parameter() -> None:
    log = truth(1)
    off = log["time_s"] > 5000.0
    result = Machine.of_text(TEXT).calibrate(log_with(t1_degC=log["t1_degC"] - 9.0 * off))
    assert any("t1 is left out" in sentence for sentence in result.document["left_out"])
    film = result.values["surface.convection_W_m2K"].value
    assert film == pytest.approx(15.0, rel=0.15)


def test_a_log_with_too_little_that_can_be_trusted_is_refused_with_the_cause() -> None:
    log = truth(1)
    lost = log["time_s"] > 200.0
    with pytest.raises(LogError, match=r"needs at least 300 s.*x_m could not be trusted"):
        Machine.of_text(TEXT).calibrate(log_with(x_m=np.where(lost, np.nan, log["x_m"])))


@cache
def drifting() -> dict[str, np.ndarray]:
    """A log in which one sensor drifts by 1.5 K, but only until the part that is held back."""
    log = truth(10)
    share = np.minimum(log["time_s"] / (0.6 * log["time_s"][-1]), 1.0)
    drift_K = np.where(share < 1.0, 1.5 * share, 0.0)
    return log | {"t2_degC": log["t2_degC"] + drift_K}


def _files(folder: Path) -> set[str]:
    return {path.name for path in folder.iterdir()}


def test_what_predicts_the_held_back_part_worse_is_written_by_neither_command_nor_library(
    tmp_path: Path,
) -> None:
    config, log = tmp_path / "machine.toml", tmp_path / "log.csv"
    config.write_text(TEXT, encoding="utf-8")
    with log.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(drifting())
        writer.writerows(zip(*drifting().values(), strict=True))
    output = tmp_path / "command"
    ended = CliRunner().invoke(app, ["calibrate", str(log), "--config", str(config), "--output", str(output)])
    assert ended.exit_code == 1, ended.output
    assert "the configured values are kept" in ended.stdout
    assert "held back" in ended.stdout
    assert _files(output) == {"calibration.json"}
    machine = Machine.of_text(TEXT)
    result = machine.calibrate(log)
    result.write(tmp_path / "library")
    assert _files(tmp_path / "library") == {"calibration.json"}
    assert result.machine is machine
    assert result.kept == result.document["kept"]
    assert result.kept in ended.stdout
    held_back = result.document["held_back"]
    assert held_back["after_rms_K"] > held_back["before_rms_K"]
