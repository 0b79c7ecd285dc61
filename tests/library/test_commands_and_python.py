"""A command and the method of the same name read the same logs and write the same files."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import can
import cantools
import numpy as np
import pytest
from typer.testing import CliRunner

import observer
from observer.align.aligner import AlignPlan, frames_of_log
from observer.cli import app as commands
from observer.estimate.checkpoint import CheckpointFit, Snapshot, pack
from observer.estimate.pipeline import MachineModel
from observer.library.profiles import ReportGrid
from observer.record.recorder import Part
from tests.logs.machines import machine_text
from tests.logs.recordings import recorded
from tests.record.test_can_log import DBC

CHANNELS = {"t1_degC": "T1", "t2_degC": "T2", "speed_rpm": "Speed"}
WIRES = {name: {"message": "Temperatures", "signal": signal} for name, signal in CHANNELS.items()}
AXIS = {
    "kind": "can", "interface": "virtual", "channel": "none", "dbc": "DBC", "period_s": 1.0,
    "channels": WIRES,
}  # fmt: skip
CONFIG = machine_text(
    "bearing",
    screw__expansion_1_K=12e-6,
    calibrate={"free": ["source.bearing.scale"]},
    drivers={"axis": AXIS},
)


@pytest.fixture(scope="module")
def config(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("machine")
    (folder / "rig.dbc").write_text(DBC)
    path = folder / "machine.toml"
    path.write_text(CONFIG.replace("DBC", str(folder / "rig.dbc")))
    return path


@pytest.fixture(scope="module")
def program() -> dict[str, np.ndarray]:
    """An hour in which the screw runs for half of it."""
    time_s = np.arange(3600.0) + 1_700_000_000.0
    return {"time_s": time_s, "speed_rpm": np.where(time_s - time_s[0] < 1800.0, 1500.0, 300.0)}


@pytest.fixture(scope="module")
def can_recording(config: Path, program: dict[str, np.ndarray]) -> Path:
    """A CAN recording of a machine that has 0.7 of the configured friction."""
    text = config.read_text().replace("heat_W_rpm = 0.01", "heat_W_rpm = 0.007")
    run = observer.Machine.of_text(text).simulate(program)
    database = cantools.database.load_file(config.with_name("rig.dbc"))
    path = config.with_name("run.blf")
    with can.Logger(path) as writer:
        columns = (run["time_s"], run["t1_degC"], run["t2_degC"], run["speed_rpm"])
        for time_s, t1_degC, t2_degC, speed_rpm in zip(*columns, strict=True):
            values = {"T1": t1_degC, "T2": t2_degC, "Speed": speed_rpm}
            data = database.encode_message("Temperatures", values)
            writer(can.Message(timestamp=time_s, arbitration_id=256, is_extended_id=False, data=data))
    return path


def command(*arguments: str | Path) -> str:
    """Run `observer` with arguments; return what it prints. An error of the user is raised."""
    done = CliRunner().invoke(commands, [str(argument) for argument in arguments])
    if isinstance(done.exception, observer.UserError):
        raise done.exception
    assert done.exit_code == 0, done.output
    return done.output


def contents(folder: Path) -> dict[str, object]:
    """The files of a folder by name; JSON and pages without their date."""
    files: dict[str, object] = {}
    for path in folder.iterdir():
        data: object = path.read_bytes()
        if path.suffix == ".html":
            data = re.sub(r"20\d\d-\d\d-\d\dT[\d:+]+", "", path.read_text())
        elif path.suffix == ".json":
            data = {key: value for key, value in json.loads(path.read_bytes()).items() if key != "date"}
        files[path.name] = data
    return files


def test_a_can_recording_is_calibrated(config: Path, can_recording: Path, tmp_path: Path) -> None:
    command("calibrate", can_recording, "--config", config, "--output", tmp_path / "command")
    observer.load(config).calibrate(can_recording).write(tmp_path / "python")
    assert contents(tmp_path / "command") == contents(tmp_path / "python")
    assert set(contents(tmp_path / "command")) == {"calibration.json", "config.toml"}


@pytest.fixture(scope="module")
def log(config: Path, program: dict[str, np.ndarray]) -> Path:
    """The same hour as a CSV file whose last row is cut off."""
    path = config.with_name("run.csv")
    observer.load(config).simulate(program).write(config.parent, path.name)
    *rows, last = path.read_text().splitlines(keepends=True)
    path.write_text("".join(rows) + last[: len(last) // 4])
    return path


CUT = {"accept_truncated": True}


@pytest.mark.parametrize(
    ("arguments", "method"),
    [
        (["replay"], lambda machine, log: machine.replay(log, **CUT)),
        (["forecast", "--hours", "0.5"], lambda machine, log: machine.forecast(log, hours=0.5, **CUT)),
        (
            ["identify", "--report", "--every-m", "0.1", "--every-min", "20"],
            lambda machine, log: machine.identify(log, report=ReportGrid(0.1, 1200.0), **CUT),
        ),
    ],
    ids=["replay", "forecast", "identify"],
)
def test_a_log_with_a_cut_last_row_gives_the_same_files(
    arguments: list[str], method: Any, config: Path, log: Path, tmp_path: Path
) -> None:
    options = ("--config", config, "--output", tmp_path / "command")
    with pytest.raises(observer.LogError, match="cut off"):
        command(*arguments, log, *options)
    assert not (tmp_path / "command").exists()
    command(*arguments, log, *options, "--accept-truncated")
    method(observer.load(config), log).write(tmp_path / "python")
    assert contents(tmp_path / "command") == contents(tmp_path / "python")


def test_an_output_that_cannot_be_written_is_refused_before_the_work(config: Path, tmp_path: Path) -> None:
    """The log does not exist either; a search would take minutes until the folder is needed."""
    occupied = tmp_path / "file"
    occupied.write_text("")
    for name in ("replay", "forecast", "identify", "calibrate", "discover"):
        with pytest.raises(observer.UserError, match="results cannot be written there"):
            command(name, tmp_path / "none.csv", "--config", config, "--output", occupied)


@pytest.fixture(scope="module")
def recording_config(config: Path, program: dict[str, np.ndarray]) -> Path:
    """A configuration whose service has recorded an hour of a machine with 0.7 of its friction."""
    text = config.read_text().replace("heat_W_rpm = 0.01", "heat_W_rpm = 0.007")
    run = observer.Machine.of_text(text).simulate(program)
    path = config.with_name("recording.toml")
    path.write_text(f'{config.read_text()}[record]\ndirectory = "{config.parent}/recordings"\n')
    plan = AlignPlan.of(observer.load(path).config)
    values = np.column_stack([run[name] for name in plan.channels])
    rows = (run.time_s - run.time_s[0] + 1.0, plan.channels, values)
    recorded(config.parent / "recordings", plan, run.time_s[0], *rows, name="machine-x")
    return path


@pytest.mark.parametrize("source", ["recent", "can"])
def test_command_and_library_search_recordings_alike(
    source: str, recording_config: Path, can_recording: Path, tmp_path: Path
) -> None:
    output = tmp_path / "found"
    given = ["--recent", "50min"] if source == "recent" else [can_recording]
    command("discover", *given, "--config", recording_config, "--output", output)
    by_command = contents(output)
    logs, recent_s = (None, 3000.0) if source == "recent" else (can_recording, None)
    observer.load(recording_config).discover(logs, recent_s=recent_s).write(output)
    assert contents(output) == by_command
    assert set(by_command) >= {"result.json", "report.html"}


def test_command_and_library_write_the_same_of_what_a_service_has_learnt(
    config: Path, log: Path, tmp_path: Path
) -> None:
    path = tmp_path / "learning.toml"
    path.write_text(f'{config.read_text()}[checkpoint]\ndirectory = "{tmp_path}"\n')
    machine = observer.load(path)
    model = MachineModel.of(machine.config, learns=True)
    pipeline, read = model.pipeline(), observer.read_log(log, accept_truncated=True)
    frames = next(iter(frames_of_log(read.with_channels(machine.config.channels), model.plan)))
    block = pipeline.step(frames)
    snapshot = Snapshot(float(block.time_s[-1]), *pipeline.snapshot())
    assert machine.config.checkpoint_file is not None
    machine.config.checkpoint_file.write_bytes(pack(snapshot, CheckpointFit.of(model)))
    said = command("learned", "--config", path, "--output", tmp_path / "command")
    learned = machine.learned()
    learned.write(tmp_path / "python")
    assert contents(tmp_path / "command") == contents(tmp_path / "python")
    assert set(contents(tmp_path / "python")) == {"learned.json", "config.toml"}
    assert said.startswith(repr(learned))
    assert set(learned.values) == set(learned.document["parameters"])
    assert learned.machine.config.tolerance != machine.config.tolerance


@pytest.mark.parametrize(
    ("format", "options"),
    [("c99", {}), ("st", {"single": True}), ("json", {}), ("table", {"control": "klipper", "axis": "Z"})],
)
def test_command_and_library_export_the_same_files(
    format: str, options: dict[str, Any], config: Path, can_recording: Path, tmp_path: Path
) -> None:
    given = [part for key, value in options.items() for part in (f"--{key}", value) if part is not True]
    output = ["--config", config, "--output", tmp_path / "command", "--log", can_recording]
    said = command("export", "--format", format, *given, *output)
    exported = observer.load(config).export(format, log=can_recording, **options)
    exported.write(tmp_path / "python")
    assert contents(tmp_path / "command") == contents(tmp_path / "python")
    assert all(line in said for line in exported.facts)
    assert ("reference.csv" in exported.files) == (format in ("c99", "st"))


def test_an_import_of_a_file_of_another_recorder_and_its_extract(config: Path, tmp_path: Path) -> None:
    """Channels are named, since the guess by the bare names of the columns is doubtful."""
    foreign = tmp_path / "lauf.csv"
    rows = "".join(f"{10 * i};{20 + i % 7},5;{68 + i % 5};1500\n" for i in range(60))
    foreign.write_text(f"Zeit [s];Lager;Mutter;n [rpm]\n{rows}")
    options = ["import", foreign, "--config", config, "--output"]
    with pytest.raises(observer.LogError, match="not written, because this is doubtful"):
        command(*options, tmp_path / "doubtful.csv")
    with pytest.raises(observer.LogError, match="not written, because this is doubtful"):
        observer.import_log(foreign, config).write(tmp_path / "doubtful.csv")
    assert not (tmp_path / "doubtful.csv").exists()
    columns = {"t1_degC": "Lager@degC", "t2_degC": "Mutter@degF", "speed_rpm": "n [rpm]"}
    named = [part for channel, column in columns.items() for part in ("--column", f"{channel}={column}")]
    said = command(*options, tmp_path / "command.csv", *named, "--extract", tmp_path / "command.txt")
    imported = observer.import_log([foreign], observer.load(config), columns=columns)
    imported.write(tmp_path / "python.csv")
    assert (tmp_path / "command.csv").read_bytes() == (tmp_path / "python.csv").read_bytes()
    assert imported.table in said
    assert imported.log["t2_degC"][0] == pytest.approx(20.0)
    assert observer.extract_log(foreign, tmp_path / "python.txt", config) < 20_000
    assert (tmp_path / "command.txt").read_bytes() == (tmp_path / "python.txt").read_bytes()


def test_a_damaged_recording_gives_the_same_estimates(recording_config: Path, tmp_path: Path) -> None:
    (recording,) = recording_config.parent.glob("recordings/*.csv")
    head, *rows = recording.read_bytes().splitlines(keepends=True)
    part = Part()
    part.open(tmp_path, "damaged", head, {})
    for i in range(0, len(rows), 500):
        part.write(b"".join(rows[i : i + 500]))
    damaged = part.path
    part.close()
    damaged.write_bytes(damaged.read_bytes().replace(b",20.", b",21.", 1))
    options = ("replay", damaged, "--config", recording_config, "--output", tmp_path / "command")
    machine = observer.load(recording_config)
    with pytest.raises(observer.LogError, match="checksum"):
        command(*options)
    with pytest.raises(observer.LogError, match="checksum"):
        machine.replay(damaged)
    command(*options, "--accept-damaged")
    machine.replay(damaged, accept_damaged=True).write(tmp_path / "python")
    assert contents(tmp_path / "command") == contents(tmp_path / "python")


@pytest.mark.system
def test_command_and_library_report_silent_wires_alike(config: Path) -> None:
    arguments = [sys.executable, "-m", "observer", "check", "--wires", "--json", "--config", config]
    done = subprocess.run(arguments, capture_output=True, text=True)
    assert done.returncode == 1, done.stderr
    by_command, by_python = json.loads(done.stdout), observer.load(config).check_wires()
    assert by_command["good"] is by_python["good"] is False
    channels = by_python["drivers"]["axis"]["channels"]
    assert set(by_command["drivers"]["axis"]["channels"]) == set(channels)
    assert {"t1_degC", "t2_degC", "speed_rpm"} == {name for name, one in channels.items() if one["fault"]}
