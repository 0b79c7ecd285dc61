"""`observer export` from the command line."""

from __future__ import annotations

import csv
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import Result
from typer.testing import CliRunner

import observer
from observer.cli import app
from observer.errors import ConfigError, UserError
from observer.files.writer import write_log
from observer.installation import load

RIG = Path(__file__).parents[1] / "data" / "rig" / "config.toml"


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Ten minutes of a machine that stands and is as warm as the air, then works."""
    path, time_s = tmp_path_factory.mktemp("log") / "log.csv", np.arange(0.0, 900.0, 0.5)
    rng = np.random.default_rng(3)
    columns = {f"t{i}_degC": 22.0 + 0.05 * rng.normal(size=len(time_s)) for i in range(1, 6)}
    columns |= {"ambient_degC": np.full(len(time_s), 22.0), "screw_speed_rpm": np.zeros(len(time_s)),
                "nut_position_m": np.full(len(time_s), 0.4)}  # fmt: skip
    write_log(path, time_s, columns)
    return path


def export(*arguments: object) -> Result:
    return CliRunner().invoke(app, ["export", *map(str, arguments)])


@pytest.mark.system
def test_the_reference_runs_over_a_log_beside_the_estimator(log: Path, tmp_path: Path) -> None:
    given = ["--config", str(RIG), "--output", str(tmp_path), "--log", str(log)]
    command = [sys.executable, "-m", "observer", "export", *given]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert "steps at which both are good" in done.stdout
    rows = list(csv.DictReader((tmp_path / "reference.csv").read_text().splitlines()))
    assert len(rows) == 1800
    assert rows[-1]["quality"] == "0"
    assert abs(float(rows[-1]["field_500_degC"]) - 22.0) < 0.2  # two of its σ, by the steady covariance


@pytest.mark.parametrize(("control", "name"), [("linuxcnc", "x1-thermal.comp"), ("sinumerik", "x1_eec.ini"),
                                               ("klipper", "z_thermal_adjust.cfg")])  # fmt: skip
def test_a_table_is_written_of_the_logs_end(log: Path, tmp_path: Path, control: str, name: str) -> None:
    given = ["--format", "table", "--log", log, "--control", control, "--axis", "X1"]
    done = export("--config", RIG, "--output", tmp_path, *given)
    assert done.exit_code == 0, done.output
    assert [path.name for path in tmp_path.iterdir()] == [name]


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--format", "table"], "needs --log"),
        (["--single"], "belongs to --format st"),
        (["--format", "table", "--log", "x.csv", "--axis", "X 1"], "not the name of an axis"),
    ],
)
def test_incompatible_options_are_rejected_in_a_sentence(
    tmp_path: Path, arguments: list[str], words: str
) -> None:
    done = export("--config", RIG, "--output", tmp_path / "none", *arguments)
    assert isinstance(done.exception, UserError)
    assert words in str(done.exception)
    assert len(str(done.exception).splitlines()) == 1
    assert not (tmp_path / "none").exists()


def test_what_the_service_has_learnt_is_not_left_out_in_silence(tmp_path: Path, monkeypatch: Any) -> None:
    config = tmp_path / "c.toml"
    config.write_text(f'{RIG.read_text()}\n[checkpoint]\ndirectory = "{tmp_path}"\n')
    installed = load(config)
    assert installed.checkpoint_file is not None
    installed.checkpoint_file.write_text("of another program")
    files = observer.load(config).export("json").files
    assert set(files) == {"plant.json"}, "what fits no service in force is nothing learnt"
    monkeypatch.setattr("observer.estimate.checkpoint.load", lambda _file, _fit: object())
    with pytest.raises(ConfigError, match="observer learned"):
        observer.load(config).export("json")
