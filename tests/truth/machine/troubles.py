"""What is wrong with users' logs rather than with their machines: clocks, units, columns, offsets, air."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from tests.truth.machine.cycles import RUNS
from tests.truth.machine.generate import Case, Run, logged, machine_of, trace
from tests.truth.machine.machine import SENSORS, Machine, stream
from tests.truth.machine.sensing import lagged

INPUTS = ("nut_position_m", "screw_speed_rpm")
AMBIENT = "ambient_degC"


class Trouble(NamedTuple):
    """What is wrong with some logs: the runs as written, the channels it is about, and by how much."""

    runs: list[Run]
    about: tuple[str, ...]
    by: str = ""


def _column(run: Run, channel: str) -> np.ndarray:
    return run.values[:, run.channels.index(channel)]


def _with(run: Run, **columns: np.ndarray) -> Run:
    values = run.values.copy()
    for channel, column in columns.items():
        values[:, run.channels.index(channel)] = column
    return run._replace(values=values)


def _late(runs: list[Run], _machine: Machine, rng: np.random.Generator) -> Trouble:
    """The drive's recorder has another clock than the temperatures': 2 to 5 min, in all logs."""
    late_s = float(rng.choice([-1.0, 1.0]) * rng.uniform(120.0, 300.0))
    return Trouble([_moved(run, late_s) for run in runs], (), f"{late_s:.0f} s")


def _moved(run: Run, late_s: float) -> Run:
    at = np.clip(np.searchsorted(run.time_s, run.time_s - late_s), 0, len(run.time_s) - 1)
    return _with(run, **{channel: _column(run, channel)[at] for channel in INPUTS})


UNITS: tuple[tuple[str, float, float], ...] = (
    ("t3_degC", 1.8, 32.0),
    ("t1_degC", 1.0, 273.15),
    ("nut_position_m", 1000.0, 0.0),
    ("screw_speed_rpm", 2.0 * np.pi / 60.0, 0.0),
    ("screw_speed_rpm", 1.0 / 60.0, 0.0),
    ("screw_speed_rpm", 60.0, 0.0),
    (AMBIENT, 1.8, 32.0),
    (AMBIENT, 1.0, 273.15),
)
"""Channel, factor and summand: °F, kelvin, mm, rad/s, revolutions a second or an hour."""


def _units(runs: list[Run], _machine: Machine, rng: np.random.Generator) -> Trouble:
    """A channel stands in another unit."""
    channel, factor, more = UNITS[int(rng.integers(len(UNITS)))]
    return Trouble(
        [_with(r, **{channel: _column(r, channel) * factor + more}) for r in runs],
        (channel,),
        f"{factor:.4g}",
    )


def _ambient(runs: list[Run], _machine: Machine, rng: np.random.Generator) -> Trouble:
    """The air is measured elsewhere, or only stated: off by 1 to 2 K in each log, or drifting by as much."""
    sort = rng.choice(["elsewhere", "stated", "drifts"])
    out = []
    common = float(rng.choice([-1.0, 1.0]))
    for run in runs:
        air = _column(run, AMBIENT)
        by_K = common * float(rng.uniform(1.0, 2.0))
        if sort == "elsewhere":
            air = air + by_K
        elif sort == "stated":
            air = np.full_like(air, np.round(air.mean() + by_K, 1))
        else:
            air = air + by_K * (run.time_s - run.time_s[0]) / (run.time_s[-1] - run.time_s[0])
        out.append(_with(run, **{AMBIENT: np.round(air, 2)}))
    return Trouble(out, (AMBIENT,), str(sort))


def _exchanged(runs: list[Run], _machine: Machine, rng: np.random.Generator) -> Trouble:
    """Two sensors' columns change places."""
    a, b = (f"{SENSORS[i]}_degC" for i in sorted(rng.choice(len(SENSORS), 2, replace=False)))
    return Trouble([_with(r, **{a: _column(r, b), b: _column(r, a)}) for r in runs], (a, b))


def _follows(runs: list[Run], machine: Machine, rng: np.random.Generator) -> Trouble:
    """A sensor at an end touches the bearing: it reads more with the bearing's heat, half a minute late."""
    end = int(rng.integers(2))
    sensor = f"{SENSORS[-end]}_degC"
    per_W = float(rng.uniform(0.06, 0.15))
    out = []
    for run in runs:
        heat_W = machine.physics.friction_W_rpm[1 + end] * np.abs(_column(run, "screw_speed_rpm"))
        step_s = float(np.median(np.diff(run.time_s)))
        more_K = per_W * lagged(heat_W[:, None], step_s, np.array([30.0]))[:, 0]
        out.append(_with(run, **{sensor: np.round(_column(run, sensor) + more_K, 2)}))
    return Trouble(out, (sensor,), f"{per_W:.3f} K/W")


def _offsets(runs: list[Run], _machine: Machine, rng: np.random.Generator) -> Trouble:
    """Every sensor has an offset of its own, of 1 to 2 K rms."""
    off_K = rng.standard_normal(len(SENSORS))
    off_K *= float(rng.uniform(1.0, 2.0)) / np.sqrt(np.mean(off_K**2))
    channels = [f"{s}_degC" for s in SENSORS]
    return Trouble(
        [_with(r, **{c: _column(r, c) + o for c, o in zip(channels, off_K, strict=True)}) for r in runs], ()
    )


SPOILT: dict[str, Callable[[list[Run], Machine, np.random.Generator], Trouble]] = {
    "heat starts late": _late,
    "units": _units,
    "ambient": _ambient,
    "sensors exchanged": _exchanged,
    "sensor follows the heater": _follows,
    "offsets": _offsets,
}
BETWEEN = "heat differs between logs"
TROUBLES = (*SPOILT, BETWEEN)


def troubled(case: Case, trouble: str) -> Trouble:
    """The runs of a case with a trouble of their logs, drawn from the case's seed."""
    rng, machine = stream(case.seed, case.name, "trouble"), machine_of(case)
    names = RUNS[: case.logs]
    if trouble != BETWEEN:
        return SPOILT[trouble]([logged(case, n, trace(case, n, machine)) for n in names], machine, rng)
    off = rng.permutation([1.0, *(1.0 + rng.choice([-1.0, 1.0]) * rng.uniform(0.08, 0.15, 2))])
    runs = []
    for name, factor in zip(names, off, strict=False):
        physics = machine.physics._replace(friction_W_rpm=machine.physics.friction_W_rpm * factor)
        heated = Machine(**{**vars(machine), "physics": physics})
        runs.append(logged(case, name, trace(case, name, heated)))
    return Trouble(runs, (), " ".join(f"{factor:.3f}" for factor in off))
