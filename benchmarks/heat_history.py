"""Heat histories of whole logs: a moving nut by all methods, what tolerances cost, and a whole day."""

from __future__ import annotations

import subprocess
import sys
import time
from functools import partial
from pathlib import Path

import numpy as np

from benchmarks.table import Result, judged
from benchmarks.timing import medians_s, shown
from observer.align.aligner import frames_of_log
from observer.config.estimator import EstimatorSettings
from observer.config.machine import Config
from observer.estimate.pipeline import MachineModel
from observer.estimate.replay import inputs_of
from observer.files.logs import Log
from observer.frames import Inputs
from observer.history.history import Method, MethodOptions
from observer.history.identify import heat_history
from observer.history.smoother import smooth_heats
from observer.history.tolerances import changes_within
from observer.installation import load
from observer.model.build import build_plant
from observer.model.plant import Plant
from observer.model.simulate import simulate, start
from tests.logs.inputs import even_inputs
from tests.logs.machines import config_of

LONG_STEPS, ROUGH_STEPS, DAY = 30_000, 15_000, 172_800
METHODS: tuple[Method, ...] = ("smoother", "tikhonov", "conjugate-gradient")
DEMO = Path(__file__).parents[1] / "config" / "demo.toml"


def results() -> list[Result]:
    """Two hours and more of a moving nut by each method; then 24 h at 2 Hz."""
    return [*(row for method in METHODS for row in by_method(method)), within_tolerances(), *a_day()]


def by_method(method: Method) -> list[Result]:
    """Time and memory of the demo's axis as delivered, its nut moving, in a process of its own."""
    seconds, before_MB, peak_MB = _in_a_process(method)
    grown_MB = peak_MB - before_MB
    return [
        Result(
            f"identify {LONG_STEPS:,} rows of a moving nut by {method}",
            shown(seconds),
            goal="≤ 30 s",
            met=seconds <= 30.0,
        ),
        Result(
            "  memory for it, inputs and results included",
            f"{grown_MB:.0f} MB",
            f"{before_MB:.0f} MB before",
            goal="≤ 500 MB in all",
            met=peak_MB <= 500.0,
        ),
    ]


def _in_a_process(work: str) -> tuple[float, float, float]:
    """Seconds, and the peak of memory before and after, MB: a peak stays on a process' record."""
    command = [sys.executable, "-m", "benchmarks.heat_history", work]
    figures = subprocess.run(command, capture_output=True, text=True, check=True).stdout.split()
    seconds, before_MB, peak_MB = (float(value) for value in figures)
    return seconds, before_MB, peak_MB


def within_tolerances() -> Result:
    """The demo's axis as delivered, its nut moving, beside the same with everything taken for known."""
    config, plant, blocks = _of_demo(ROUGH_STEPS)
    options, within = MethodOptions(), partial(changes_within, config, blocks)
    works = {
        "known": lambda: heat_history(plant, config.estimator, blocks, options),
        "within": lambda: heat_history(plant, config.estimator, blocks, options, within),
    }
    taken = medians_s(works, repetitions=5)
    return judged(
        f"identify {ROUGH_STEPS:,} rows within the default tolerances, 5 sensors",
        shown(taken["within"]),
        f"everything known {shown(taken['known'])}",
        taken["within"] / taken["known"],
        at_most=5,
    )


def a_day() -> list[Result]:
    """Time and memory of a day, in a process of its own."""
    seconds, before_MB, peak_MB = _in_a_process("day")
    grown = f"{before_MB:.0f} MB before"
    return [
        Result("heat history of 172,800 samples", shown(seconds), goal="≤ 2 s", met=seconds <= 2.0),
        Result(
            "  memory for it, inputs and results included",
            f"{peak_MB - before_MB:.0f} MB",
            grown,
            goal="≤ 60 MB",
            met=peak_MB - before_MB <= 60.0,
        ),
    ]


def _of_demo(steps: int) -> tuple[Config, Plant, list[Inputs]]:
    """A log at 2 Hz of the demo's machine, which runs by its laws: forty minutes of every hour."""
    config = load(DEMO)
    machine, time_s = MachineModel.of(config), 0.5 * np.arange(steps, dtype=float)
    plant, rng = machine.plant, np.random.default_rng(1)
    speed_rpm = np.where(time_s % 3600.0 < 2400.0, 1500.0, 0.0)
    nut_m = 0.475 + 0.3 * np.sin(np.cumsum(speed_rpm) * (0.5 / 1500.0))
    channels = ("nut_position_m", "screw_speed_rpm", *(sensor.channel for sensor in config.sensor))
    sensors_degC = 22.0 + 0.06 * rng.standard_normal((steps, len(config.sensor)))
    log = Log(Path("log.csv"), time_s, channels, np.column_stack([nut_m, speed_rpm, sensors_degC]))
    blocks, state = (
        inputs_of(frames_of_log(log, machine.plan), machine.drive),
        start(plant, 22.0, np.zeros(3)),
    )
    for block in blocks:
        state, rows = simulate(plant, state, block)
        block.y_degC[:] += rows[:, plant.rows.sensor_slice] - 22.0
    return config, plant, blocks


def _even_log(steps: int) -> tuple[Plant, Inputs]:
    """A plant and a log of it, with heats that stand above their laws for half of the time."""
    plant = build_plant(config_of(8, 4, grid=2))
    inputs = even_inputs(plant, steps)
    warming = np.minimum(np.arange(steps), steps / 2)[:, None] * (0.5 * 4.0 / steps)
    return plant, inputs._replace(y_degC=inputs.y_degC + warming)


def _peak_MB() -> float:
    """The peak of this process alone; the value of `resource` starts from its parent's peak."""
    status = Path("/proc/self/status").read_text(encoding="ascii")
    return float(status.split("VmHWM:")[1].split()[0]) / 1024.0


def _measure_a_day() -> None:
    """Print the median seconds, and the peak of memory before and after, MB."""
    smooth_heats(*_even_log_with_gate(50))
    before_MB = _peak_MB()
    day = _even_log_with_gate(DAY)
    seconds = medians_s({"day": lambda: smooth_heats(*day)}, repetitions=3)["day"]
    print(seconds, before_MB, _peak_MB())


def _measure_method(method: Method) -> None:
    """Print the seconds, and the peak of memory before and after, MB."""
    before_MB = _peak_MB()
    config, plant, blocks = _of_demo(LONG_STEPS)
    within, options = partial(changes_within, config, blocks), MethodOptions(method)
    begin_s = time.process_time()  # of a core: others may be at work
    heat_history(plant, config.estimator, blocks, options, within)
    print(time.process_time() - begin_s, before_MB, _peak_MB())


def _even_log_with_gate(steps: int) -> tuple[Plant, EstimatorSettings, list[Inputs]]:
    plant, inputs = _even_log(steps)
    return plant, EstimatorSettings(), [inputs]


if __name__ == "__main__":
    if sys.argv[1] == "day":
        _measure_a_day()
    for asked in METHODS:
        if sys.argv[1] == asked:
            _measure_method(asked)
