"""Heat histories of whole logs: the smoother beside dense Tikhonov at the same prior, and a whole day."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from benchmarks.table import Result, judged
from benchmarks.timing import medians_s, shown
from observer.align.aligner import frames_of_log
from observer.config import Config
from observer.estimate.pipeline import MachineModel
from observer.estimate.replay import inputs_of
from observer.files.logs import Log
from observer.frames import FloatArray, Inputs
from observer.history.conjugate_gradient import Convolution, descend
from observer.history.history import HeatHistory, MethodOptions
from observer.history.identify import heat_history
from observer.history.smoother import smooth_heats
from observer.history.stacked import Prior, StackedProblem, stacked_problem
from observer.history.tikhonov import normal_equations, solve
from observer.history.tolerances import changes_within
from observer.installation import load
from observer.model.build import build_plant
from observer.model.plant import Plant
from observer.model.simulate import simulate, start
from observer.tables.estimator import EstimatorSettings
from tests.logs.inputs import even_inputs
from tests.logs.machines import config_of

STEPS, ROUGH_STEPS, DAY = 1_000, 15_000, 172_800
DEMO = Path(__file__).parents[1] / "config" / "demo.toml"
OPEN_GATE = EstimatorSettings(gate_sigma=1e9)


def results() -> list[Result]:
    """Li's size, 1000 steps of 3 heats and 4 sensors at 8 modes; then 24 h at 2 Hz."""
    plant, inputs = _even_log(STEPS)
    inputs = inputs._replace(law_W=np.zeros_like(inputs.law_W))
    problem, _ = stacked_problem(plant, [inputs])
    prior, H = Prior.of(plant, problem.dt_s, 1), Convolution(problem.response_K_W)
    held_plant, held_inputs = _held(plant, inputs, prior)
    works = {
        "smoother": lambda: smooth_heats(held_plant, OPEN_GATE, [held_inputs]),
        "gradients": lambda: descend(problem, prior, H, problem.rise_K),
        "dense": lambda: _tikhonov(problem, prior),
    }
    taken = medians_s(works, repetitions=3)
    apart = _apart(_tikhonov(problem, prior), smooth_heats(held_plant, OPEN_GATE, [held_inputs]))
    return [
        judged(
            "heat history, 1000 steps, 3 heats, smoother",
            shown(taken["smoother"]),
            f"dense Tikhonov {shown(taken['dense'])}",
            taken["dense"] / taken["smoother"],
            at_least=100,
        ),
        Result("  the same answer, heats and σ", f"{apart:.1g}", goal="≤ 1e-06", met=apart <= 1e-6),
        Result(
            "  conjugate gradients, ended at the noise",
            shown(taken["gradients"]),
            f"dense Tikhonov {shown(taken['dense'])}",
            f"{taken['dense'] / taken['gradients']:.3g} ×",
        ),
        within_tolerances(),
        *a_day(),
    ]


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
    """Time and memory of a day, in a process of its own: a peak in memory stays on a process' record."""
    command = [sys.executable, "-m", "benchmarks.heat_history"]
    told = subprocess.run(command, capture_output=True, text=True, check=True).stdout.split()
    seconds, before_MB, peak_MB = (float(value) for value in told)
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


def _held(plant: Plant, inputs: Inputs, prior: Prior) -> tuple[Plant, Inputs]:
    """The prior of the stacked equation for the smoother: heats that jump, and are held over each step."""
    still = np.zeros_like(plant.random_walk_W2_s)
    plant = replace(
        plant,
        random_walk_W2_s=still,
        law_uncertainty=np.ones_like(still),
        field_noise_Q=np.zeros_like(plant.field_noise_Q),
    )
    return plant, inputs._replace(law_jump_W=np.tile(prior.step_W, (len(inputs), 1)))


def _tikhonov(problem: StackedProblem, prior: Prior) -> tuple[FloatArray, FloatArray]:
    return solve(problem, prior, normal_equations(problem, prior), 1.0)


def _apart(dense: tuple[FloatArray, FloatArray], smoothed: HeatHistory) -> float:
    """The largest difference of heats and σ, as a share of the largest of each."""
    pairs = ((dense[0], smoothed.heat_W[1:]), (dense[1], smoothed.heat_sigma_W[1:]))
    return float(max(np.abs(a - b).max() / np.abs(a).max() for a, b in pairs))


def _peak_MB() -> float:
    """The peak of this process alone; what `resource` tells begins with that of its parent."""
    status = Path("/proc/self/status").read_text(encoding="ascii")
    return float(status.split("VmHWM:")[1].split()[0]) / 1024.0


def _measure_a_day() -> None:
    """Print the median seconds, and the peak of memory before and after, MB."""
    smooth_heats(*_even_log_with_gate(50))
    before_MB = _peak_MB()
    day = _even_log_with_gate(DAY)
    seconds = medians_s({"day": lambda: smooth_heats(*day)}, repetitions=3)["day"]
    print(seconds, before_MB, _peak_MB())


def _even_log_with_gate(steps: int) -> tuple[Plant, EstimatorSettings, list[Inputs]]:
    plant, inputs = _even_log(steps)
    return plant, EstimatorSettings(), [inputs]


if __name__ == "__main__":
    _measure_a_day()
