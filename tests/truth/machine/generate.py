"""Makes cases: logs and a configuration for the user, and the answer for somebody else."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass, replace
from functools import reduce
from pathlib import Path
from typing import NamedTuple

import numpy as np

from tests.truth.machine.cycles import (
    PROGRAMMES,
    RUNS,
    Phase,
    START_m,
    STEP_s,
    build_schedule,
    draw_air,
    programme,
    steps_of,
)
from tests.truth.machine.effects import LIBRARY, Effect, apply
from tests.truth.machine.faults import FAULTS, sample_times_s, spoil
from tests.truth.machine.housings import on_bodies, with_bodies
from tests.truth.machine.logs import CHANNELS, FORMATS, configuration, write_log
from tests.truth.machine.machine import SENSORS, SOURCES, Machine, as_users_have_it, draw_machine, stream
from tests.truth.machine.motion import positions_at
from tests.truth.machine.outside import OUTSIDE, Facts, Scene
from tests.truth.machine.physics import LEFT, FloatArray
from tests.truth.machine.run import Result, run_machine
from tests.truth.machine.sensing import shown, true_readings

LINKS_OFF = 0.2


@dataclass(frozen=True)
class Case:
    """One machine with what is hidden in it, and what it is run with.

    Two cases of the same name and seed are the same machine, whatever is hidden in them. `unknown`: parts
    that neither the machine nor its configuration has, beside those that an effect implies. `typical`:
    sensors and screw are as far off as a typical user's, and his configuration says no more of that than its
    defaults. `logs`: how many of the runs there are. `short`: by what part of its rise above the air each
    sensor reads too little, mean and standard deviation. `torque`: by what part the nut's differs from one
    run to the next, standard deviation. `air_K`: by how much the air varies, which is measured. `housed`: its
    sensors are on the nut and both bearings' housings, by links that are 20 % off, and none is on the screw.
    """

    name: str
    effects: tuple[Effect, ...] = ()
    seed: int = 0
    cycle: str = "standard"
    faults: tuple[str, ...] = ()
    unknown: tuple[str, ...] = ()
    typical: bool = False
    logs: int = len(RUNS)
    short: tuple[float, float] = (0.0, 0.0)
    torque: float = 0.0
    air_K: float = 0.5
    housed: bool = False

    def __post_init__(self) -> None:
        for given, known in (
            ([e.kind for e in self.effects], [*LIBRARY, *OUTSIDE]),
            ([self.cycle], tuple(PROGRAMMES)),
            (self.faults, FAULTS),
            (self.unknown, ("film", *SOURCES[1:])),
        ):
            if strange := set(given) - set(known):
                raise ValueError(f"case {self.name}: unknown {strange}; there are {known}")

    @property
    def rough(self) -> bool:
        """Whether more is off than a configuration that was measured says."""
        return self.typical or any(self.short) or self.torque > 0.0 or "minutes" in self.faults

    @property
    def unmodelled(self) -> tuple[str, ...]:
        """What the configuration does not have: "film", "left_bearing", "right_bearing"."""
        parts = set(self.unknown)
        for effect in self.effects:
            if effect.kind == "surface_convection":
                parts.add("film")
            if effect.kind == "end_heat":
                parts.add(f"{effect.target}_bearing")
        return tuple(sorted(parts))


class Run(NamedTuple):
    """One log: `values` (n, channels) at `time_s` (n,); NaN is a missing sample."""

    time_s: FloatArray
    channels: tuple[str, ...]
    values: FloatArray


@dataclass(frozen=True)
class Traced:
    """A run with what no log shows; `air_degC` (K + 1,) is the logged air, `reading_degC` free of noise."""

    scene: Scene
    result: Result
    air_degC: FloatArray
    reading_degC: FloatArray
    facts: dict[str, list[Facts]]


def machine_of(case: Case) -> Machine:
    """The machine of a case, with its effects of the library."""
    machine = draw_machine(case.seed, case.name)
    if case.typical:
        machine = as_users_have_it(machine, case.seed, case.name)
    if case.housed:
        machine = with_bodies(machine, LINKS_OFF, stream(case.seed, case.name, "links"))
    physics = machine.physics
    if "film" in case.unmodelled and "surface_convection" not in (e.kind for e in case.effects):
        physics = physics._replace(film_W_m2K=np.zeros_like(physics.film_W_m2K))
    friction = physics.friction_W_rpm.copy()
    for index, source in enumerate(SOURCES[1:]):
        if source in case.unmodelled:
            friction[LEFT + index] = 0.0
    if any(case.short):
        mean, apart = case.short
        toward = mean + apart * stream(case.seed, case.name, "short").standard_normal(len(SENSORS))
        machine = replace(machine, toward_air=toward)
    known = [e for e in case.effects if e.kind in LIBRARY]
    return reduce(apply, known, replace(machine, physics=physics._replace(friction_W_rpm=friction)))


def trace(
    case: Case, run: str, machine: Machine | None = None, phases: tuple[Phase, ...] | None = None
) -> Traced:
    """Run one of the runs "a", "b", "c" of a case, or of another machine in its place; or a run of another
    name through phases that somebody asks for.
    """
    machine = machine or machine_of(case)
    phases = phases or programme(case.cycle, run, stream(case.seed, case.name, run, "programme"))
    rng, steps = stream(case.seed, case.name, run, "air"), steps_of(phases)
    mean_degC = stream(case.seed, case.name, "season").uniform(18.0, 25.0) + rng.uniform(-1.0, 1.0)
    logged = draw_air(float(mean_degC), steps, rng, case.air_K)
    felt = logged + machine.air_drift_K_h * np.arange(steps + 1) * STEP_s / 3600.0
    schedule = build_schedule(phases, START_m.get(run, phases[0].low_m), felt)
    if case.torque:
        factor = 1.0 + case.torque * stream(case.seed, case.name, run, "torque").standard_normal()
        schedule = schedule._replace(nut_factor=factor * schedule.nut_factor)
    scene, facts = Scene(machine, schedule, np.ones((steps + 1, len(machine.lag_s)))), {}
    for effect in case.effects:
        if effect.kind in OUTSIDE:
            rng = stream(case.seed, case.name, run, effect.kind)
            scene, facts[effect.kind] = OUTSIDE[effect.kind](scene, effect, rng)
    result = run_machine(scene.machine.physics, scene.schedule, scene.machine.sensor_m)
    seen = result.body_degC if case.housed else result.section_degC
    reading = true_readings(scene.machine, seen, felt, scene.contact, STEP_s)
    return Traced(scene, result, logged, reading, facts)


def logged(case: Case, run: str, traced: Traced) -> Run:
    """What the log of a run shows: rows, noise, rounding, faults."""
    schedule = traced.scene.schedule
    rng = stream(case.seed, case.name, run, "log")
    rows_s = sample_times_s(traced.scene.duration_s, STEP_s, case.faults, rng)
    grid_s = np.arange(len(traced.air_degC)) * STEP_s
    step = np.minimum((rows_s / STEP_s - 1e-9).astype(int), len(schedule.speed_rpm) - 1)
    travel_m_s = schedule.speed_rpm / 60.0 * traced.scene.machine.physics.lead_m
    nut_m = positions_at(rows_s, STEP_s, schedule.start_m, travel_m_s, schedule.low_m, schedule.high_m)
    reading = np.column_stack([np.interp(rows_s, grid_s, column) for column in traced.reading_degC.T])
    sensors = spoil(shown(reading, rng, traced.scene.machine.step_K), case.faults, rng)
    air = np.round(np.interp(rows_s, grid_s, traced.air_degC), 2)
    channels = (*CHANNELS[: sensors.shape[1]], *CHANNELS[len(SENSORS) :])
    return Run(
        rows_s, channels, np.column_stack([sensors, np.round(nut_m, 4), schedule.speed_rpm[step], air])
    )


def runs_of(case: Case) -> list[Run]:
    """The logs of a case."""
    machine = machine_of(case)
    return [logged(case, run, trace(case, run, machine)) for run in RUNS[: case.logs]]


def write_case(case: Case, folder: Path, without: tuple[str, ...] = ()) -> list[Path]:
    """Write `run_a.csv.gz` … and `config.toml`, which say nothing of what is hidden; return the logs.

    `without`: effects that the configuration keeps from a search.
    """
    folder.mkdir(parents=True, exist_ok=True)
    logs = [folder / f"run_{name}.csv.gz" for name in RUNS[: case.logs]]
    for log, run in zip(logs, runs_of(case), strict=True):
        write_log(log, run.time_s, run.values, {name: FORMATS[name] for name in run.channels})
    text = configuration(case.unmodelled, without, known=not case.rough)
    (folder / "config.toml").write_text(on_bodies(text) if case.housed else text, encoding="utf-8")
    return logs


def answer_of(case: Case) -> dict[str, object]:
    """What is hidden in a case, when and where, and the machine's true parameters."""
    machine = machine_of(case)
    physics = machine.physics
    return {
        "case": asdict(case),
        "library": [asdict(e) for e in case.effects if e.kind in LIBRARY],
        "outside": [asdict(e) for e in case.effects if e.kind in OUTSIDE],
        "unmodelled": case.unmodelled,
        "facts": {run: trace(case, run, machine).facts for run in RUNS},
        "true": {
            "screw.conductivity_W_mK": physics.conductivity_W_mK,
            "screw.capacity_J_m3K": physics.capacity_J_m3K,
            "surface.convection_W_m2K": float(physics.film_W_m2K.mean()),
            "source.nut.torque_Nm": float(physics.friction_W_rpm[0] / (0.5 * np.pi / 30.0)),
            "source.left_bearing.heat_W_rpm": float(physics.friction_W_rpm[1]),
            "source.right_bearing.heat_W_rpm": float(physics.friction_W_rpm[2]),
            "lag_s": machine.lag_s.tolist(),
        },
    }


def write_answer(case: Case, answers: Path, name: str) -> Path:
    """Write the answer of a case as JSON into a folder that must hold no log. Raises `ValueError`."""
    answers.mkdir(parents=True, exist_ok=True)
    if any(answers.glob("*.csv.gz")) or (answers / "config.toml").exists():
        raise ValueError(f"{answers}: an answer never lies beside the logs; give another folder")
    path = answers / f"{name}.json"
    path.write_text(json.dumps(answer_of(case), indent=1), encoding="utf-8")
    return path
