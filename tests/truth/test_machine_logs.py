"""Logs and answers: the same for the same seed, apart from each other, and as damaged as asked for."""

from __future__ import annotations

import csv
import gzip
import json
import tomllib
from pathlib import Path

import numpy as np
import pytest

from tests.truth.machine.cycles import RUNS
from tests.truth.machine.effects import Effect
from tests.truth.machine.entries import FIRST_SEED, campaign
from tests.truth.machine.generate import LINKS_OFF, Case, runs_of, trace, write_answer, write_case
from tests.truth.machine.logs import CHANNELS
from tests.truth.machine.visibility import hidden_rms_K

LOSSY = Effect("end_conduction", "right", {"conductance_W_K": 0.12})


def test_the_same_case_gives_the_same_bytes(tmp_path: Path) -> None:
    case = Case("same", (LOSSY,), 7)
    first, second = write_case(case, tmp_path / "one"), write_case(case, tmp_path / "two")
    other = write_case(Case("same", (LOSSY,), 8), tmp_path / "three")
    for a, b, c in zip(first, second, other, strict=True):
        assert a.read_bytes() == b.read_bytes() != c.read_bytes()


def test_a_log_reveals_nothing_of_what_is_hidden(tmp_path: Path) -> None:
    """Folder, configuration and header are those of a machine with nothing hidden."""
    logs = write_case(Case("known", (LOSSY,), 7), tmp_path / "logs")
    plain = write_case(Case("known", (), 7), tmp_path / "plain")
    assert sorted(p.name for p in logs[0].parent.iterdir()) == sorted(
        p.name for p in plain[0].parent.iterdir()
    )
    assert (tmp_path / "logs/config.toml").read_text() == (tmp_path / "plain/config.toml").read_text()
    with gzip.open(logs[0], "rt") as file:
        header, row = next(rows := csv.reader(file)), next(rows)
    assert header == ["time_s", *CHANNELS]
    assert len(row) == len(header)
    with pytest.raises(ValueError, match="never lies beside the logs"):
        write_answer(Case("known", (LOSSY,), 7), tmp_path / "logs", "known")
    answer = json.loads(write_answer(Case("known", (LOSSY,), 7), tmp_path / "answers", "known").read_text())
    assert answer["library"] == [
        {"kind": "end_conduction", "target": "right", "parameters": LOSSY.parameters}
    ]


def test_of_a_machine_with_housings_the_log_shows_its_bodies(tmp_path: Path) -> None:
    """The bodies, by links that are off, and no place on the screw."""
    case = Case("housed", seed=7, typical=True, housed=True, logs=1)
    (path,) = write_case(case, tmp_path)
    sensors, table = CHANNELS[:3], tomllib.loads((tmp_path / "config.toml").read_text(encoding="utf-8"))
    with gzip.open(path, "rt") as file:
        assert next(csv.reader(file)) == ["time_s", *sensors, *CHANNELS[-3:]]
    assert [s["channel"] for s in table["sensor"]] == list(sensors)
    assert all("on" in s for s in table["sensor"])
    traced = trace(case, "a")
    machine, (run,) = traced.scene.machine, runs_of(case)
    shown_K = traced.result.body_degC[-1] + machine.offset_K
    np.testing.assert_allclose(run.values[-1, :3], shown_K, atol=0.3)
    contact = machine.physics.body_W_K / [link["conductance_W_K"] for link in table["link"][:3]]
    np.testing.assert_allclose(abs(contact - 1.0), LINKS_OFF)


def test_the_configuration_lacks_the_effect(tmp_path: Path) -> None:
    film = Effect("surface_convection", None, {"coefficient_W_m2K": 10.0})
    bearing = Effect("end_heat", "left", {"heat_W_rpm": 1e-3})
    write_case(Case("lacks", (film, bearing), 7), tmp_path, ("coolant",))
    config = tomllib.loads((tmp_path / "config.toml").read_text())
    assert config["surface"]["convection_W_m2K"] == 0.0
    assert [s["name"] for s in config["source"]] == ["nut", "right_bearing"]
    assert config["calibrate"]["free"] == ["source.nut.torque_Nm", "source.right_bearing.heat_W_rpm"]
    assert config["discover"] == {"without": ["coolant"]}


def test_noise_and_rounding() -> None:
    """White noise of 0.05 K in steps of 0.01 K at rest, before anything has moved."""
    run = runs_of(Case("noise", (), 7))[0]
    rest = run.values[:1000, :5]
    assert 0.045 < np.std(np.diff(rest, axis=0)) / np.sqrt(2) < 0.055
    np.testing.assert_allclose(rest * 100, np.round(rest * 100), atol=1e-9)
    assert 7200 <= run.time_s[-1] <= 9600


@pytest.mark.parametrize("fault", ["gaps", "uneven", "stuck", "missing"])
def test_faults(fault: str) -> None:
    run = runs_of(Case("faulty", (), 7, faults=(fault,)))[1]
    step_s, sensors = np.diff(run.time_s), run.values[:, :5]
    assert np.all(step_s > 0.0)
    assert (step_s.max() > 60.0) == (fault == "gaps")
    assert (np.unique(step_s.round(3)).size > 20) == (fault == "uneven")
    assert np.isnan(sensors).any() == (fault == "missing")
    assert (np.diff(sensors[-3000:], axis=0) == 0.0).all(axis=0).any() == (fault == "stuck")


def test_strengths_are_what_the_sensors_see() -> None:
    """The first rung shows by 0.05 to 0.1 K; an exponent at one speed not at all: torque takes it up."""
    weak = next(e for e in campaign() if e.name == f"ladder.sensor_bias.t2.1.{FIRST_SEED}")
    assert 0.05 < hidden_rms_K(weak.case, RUNS[:1]) < 0.1
    unseen = next(e for e in campaign() if e.name == f"poor.exponent.{FIRST_SEED}")
    assert hidden_rms_K(unseen.case, RUNS[:1]) < 1e-6
