"""Logs of machines that are as configured: the product's model run forward, with the noise of sensors."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

import observer
from observer.config.machine import Config
from observer.discovery.experiment import Habits, Phase, frames_of
from observer.estimate.pipeline import MachineModel
from observer.files.logs import read_log
from observer.files.writer import write_log
from observer.fit.runs import Run
from observer.frames import FloatArray, FrameBlock, Inputs
from observer.installation import load
from observer.model.build import build_plant
from observer.model.cycle import SHIFT, SPEED_RPM
from observer.model.drive import Drive
from observer.model.plant import Plant
from observer.model.simulate import simulate, start, start_from_sensors
from tests.logs.machines import LENGTHS_M, configuration

LOW_m, HIGH_m, AIR_degC = 0.15, 0.80, 22.0


def frames(config: Config, time_s: FloatArray, columns: dict[str, FloatArray]) -> FrameBlock:
    """A log without gaps as one block; a NaN cell is missing."""
    values = np.column_stack([columns[name] for name in config.channels])
    fresh = np.isfinite(values)
    return FrameBlock(
        channels=config.channels,
        time_s=time_s,
        dt_s=np.diff(time_s, prepend=time_s[0]),
        values=values,
        fresh=fresh,
        quality=np.where(fresh, 0, 1).astype(np.int8),
        age_s=np.zeros_like(values),
        path={},
    )


def run_model(plant: Plant, drive: Drive, block: FrameBlock, start_degC: float) -> tuple[Inputs, FloatArray]:
    """The inputs of a log, and what the sensors read (K, s) where the machine began at one temperature."""
    _, u = drive.run(drive.initial(), block)
    _, rows = simulate(plant, start(plant, start_degC, u.law_W[0]), u)
    return u, rows[:, : plant.rows.sensors]


def simulated_rows(config: Config, run: Run) -> tuple[FloatArray, FloatArray]:
    """The state that a run's first readings show, and what its sensors would read row by row (K, s)."""
    plant = build_plant(config).sensors_only()
    drive = Drive(config, plant)
    _, u = drive.run(drive.initial(), run.frames)
    state = start_from_sensors(plant, run.start_degC, run.start_R_K2, u.law_W[0], u.z_start[0])
    return state, simulate(plant, state, u)[1]


def made_log(
    truth: Config, seed: int, *, minutes: float = 100.0, heater_W: float = 15.0, speed_rpm: float = 1000.0
) -> FrameBlock:
    """A log of the machine `truth`: rest, heater on, bearing on, rest; one row every 2 s, white noise."""
    time_s = np.arange(0.0, 60 * minutes, 2.0)
    share = time_s / (60 * minutes)
    columns = {
        "heater_W": np.where((share > 0.05) & (share < 0.5), heater_W, 0.0),
        "n_rpm": np.where((share > 0.3) & (share < 0.7), speed_rpm, 0.0),
    }
    blank = {s.channel: np.full_like(time_s, 20.0) for s in truth.sensor}
    plant = build_plant(truth)
    _, rows = run_model(plant, Drive(truth, plant), frames(truth, time_s, columns | blank), 20.0)
    noise_K = 0.05 * np.random.default_rng(seed).normal(size=(len(time_s), len(truth.sensor)))
    for i, sensor in enumerate(truth.sensor):
        columns[sensor.channel] = rows[:, i] + noise_K[:, i]
    return frames(truth, time_s, columns)


def shift_log(config: Config) -> tuple[MachineModel, Inputs]:
    """A machine over the standard shift, and its inputs, a step a second, with the noise of its sensors."""
    machine = MachineModel.of(config, learns=True)
    middle_m = (LOW_m + HIGH_m) / 2
    phases = [
        Phase(duration_s, SPEED_RPM * works, *((LOW_m, HIGH_m) if works else (middle_m, middle_m + 1e-4)))
        for duration_s, works in SHIFT
    ]
    block = frames_of(config, phases, Habits(SPEED_RPM, SPEED_RPM, LOW_m, HIGH_m, 0.01, AIR_degC))
    u, rows = run_model(machine.plant, machine.drive, block, AIR_degC)
    noise_K = np.random.default_rng(1).standard_normal(rows.shape) * np.sqrt(machine.plant.noise_R_K2)
    return machine, u._replace(y_degC=rows + noise_K)


def written_log(config: Path, log: Path, rows: int, step_s: float = 1.0, speed_rpm: float = 1500.0) -> Path:
    """A log of the machine: a standstill, then traverses at one speed."""
    time_s = step_s * np.arange(rows)
    speed = np.where(time_s > time_s[-1] / 10, speed_rpm, 0.0)
    low, high = load(config).source[0].stroke_m or (0.0, 1.0)
    phase = np.mod(np.cumsum(speed) * step_s / 60 * 0.01 / (high - low), 2.0)
    nut_m = low + (high - low) * (1 - np.abs(1 - phase))
    program = log.with_name("program.parquet")
    log.parent.mkdir(parents=True, exist_ok=True)
    columns = {"nut_position_m": nut_m, "screw_speed_rpm": speed, "ambient_degC": np.full(rows, 22.0)}
    write_log(program, time_s, columns)
    observer.load(config).simulate(program).write(log.parent, log.name)
    program.unlink()
    log.with_name("overview.png").unlink()
    return log


def with_noise(log: Path, paths: Sequence[Path], seed: int) -> list[Path]:
    """Copies of a log, each with a noise of its own on its sensors."""
    rng = np.random.default_rng(seed)
    whole = read_log(log)
    sensors = [i for i, name in enumerate(whole.channels) if name.startswith("t") and name.endswith("_degC")]
    inputs = ["nut_position_m", "screw_speed_rpm", "ambient_degC"]
    kept = [whole.channels.index(name) for name in inputs] + sensors
    for path in paths:
        path.parent.mkdir(parents=True, exist_ok=True)
        values = whole.values.copy()
        values[:, sensors] += 0.05 * rng.normal(size=(len(whole), len(sensors)))
        write_log(path, whole.time_s, {whole.channels[i]: values[:, i] for i in kept})
    return list(paths)


def a_fleet(folder: Path, machines: int, logs: int, rows: int) -> Path:
    """Machines of the types in turn, each with some logs, and the table that says so."""
    lines = ["log,machine,config"]
    for kind, length_m in enumerate(LENGTHS_M[:machines]):
        config = configuration(folder, kind, f"type-{length_m:g}")
        whole = written_log(config, folder / f"whole-{kind}" / "run.parquet", rows)
        for number in range(kind, machines, len(LENGTHS_M)):
            paths = [folder / f"m{number:03}" / f"run-{i:03}.parquet" for i in range(logs)]
            with_noise(whole, paths, number)
            lines += [f"{p.relative_to(folder)},m{number:03},{config.name}" for p in paths]
    table = folder / "fleet.csv"
    table.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return table
