"""Twenty-eight minutes of a warm-up: where it will settle, how sure that is, and when.

Machines of the independent truth rest for ten minutes and then run at one speed. After 28 minutes it is
forecast, from the whole log and from the live state alone, where and when they settle, and held against a run
of twelve hours.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from campaigns.forecast.days import COARSE_M, WITHIN_UM
from observer.align.aligner import frames_of_log
from observer.estimate.pipeline import MachineModel
from observer.forecast.ahead import runner
from observer.forecast.document import Forecast, forecast
from observer.forecast.friction import FrictionBank
from observer.forecast.program import Bins, binned, joined, learnt
from observer.frames import FloatArray
from tests.learning.cover import calibrated, log_of
from tests.learning.machines import (
    AS_CONFIGURED,
    CONFIG,
    Day,
    EXPANSION_um_K_m,
    Rough,
    Specimen,
    config_of,
    draw,
    work,
)
from tests.truth.machine.cycles import Phase, STEP_s, build_schedule, draw_air, steps_of
from tests.truth.machine.machine import stream
from tests.truth.machine.run import run_machine

REST_S, WARM_S, SETTLED_S = 600.0, 1680.0, 12.0 * 3600.0
START_M = 0.3
Z95 = 1.96
COMPARED = "\n[tolerance]\nposition_m = 0.001\noffset_K = 0.0\nambient_K = 0.0\n"
"""What is said of sensors that were compared with each other and with the air's."""


class Group(NamedTuple):
    """Machines, what their configuration says beside, whether a day before calibrated it, their seed and
    number, and by how much running in differs from one day to the next, in parts of itself.
    """

    rough: Rough
    more: str = ""
    is_calibrated: bool = False
    seed: int = 9900
    machines: int = 10
    per_start: float = 0.0


_COMPARED = Rough(offset_K=0.0, ambient_K=0.0, place_m=0.001)
GROUPS = {
    "as configured": Group(AS_CONFIGURED),
    "rough": Group(Rough()),
    "rough, friction does not run in": Group(Rough(run_in=0.0)),
    "sensors compared, calibrated the day before": Group(
        _COMPARED, COMPARED, is_calibrated=True, seed=61000, machines=12
    ),
    "the same, running in otherwise, another fifth more or less each day": Group(
        replace(_COMPARED, run_in_power=0.6),
        COMPARED,
        is_calibrated=True,
        seed=61000,
        machines=12,
        per_start=0.2,
    ),
}


class PredictedSettling(NamedTuple):
    """A forecast held against the truth: rms, mean σ and the part within 95 %, of field and error over the
    screw; and the time of settling, with its band, in s; NaN where none is known.
    """

    off_K: float
    sigma_K: float
    held_field: float
    off_um: float
    sigma_um: float
    held_error: float
    said_s: float
    from_s: float
    to_s: float


def _program(seed: int, number: int) -> tuple[np.random.Generator, Phase]:
    rng = stream(seed, "warming", str(number))
    stroke = (0.2, 0.8) if rng.random() < 0.5 else (0.25, 0.7)
    return rng, Phase(WARM_S + 120.0, float(round(rng.uniform(900.0, 2400.0))), *stroke)


def warming(one: Specimen, seed: int, number: int) -> Day:
    """A rest and the first half-hour of work, at one speed."""
    rng, runs = _program(seed, number)
    return work(one, (Phase(REST_S), runs), START_M, rng, 0.0)


def the_day_before(one: Specimen, seed: int, number: int, per_start: float = 0.0) -> Day:
    """A warm-up of an hour and a half at one speed, an hour of rest, and half an hour at a lower one."""
    rng = stream(seed, "the day before", str(number))
    physics = one.machine.physics
    run_in = physics.run_in * (1.0 + per_start * stream(seed, "start", str(number)).standard_normal(3))
    one = replace(one, machine=replace(one.machine, physics=physics._replace(run_in=run_in)))
    fast, slow = rng.uniform(1500.0, 2400.0), rng.uniform(700.0, 1200.0)
    phases = (
        Phase(REST_S), Phase(5400.0, float(round(fast)), 0.2, 0.8), Phase(3600.0),
        Phase(1800.0, float(round(slow)), 0.2, 0.8), Phase(1800.0),
    )  # fmt: skip
    return work(one, phases, START_M, rng, 0.0)


def path(one: Specimen, seed: int, number: int, now_s: float) -> tuple[FloatArray, FloatArray]:
    """The true field, °C, and error, µm, in the steps of the day and of the twelve hours after a moment of
    it, if work goes on and the air stays as it is then.
    """
    rng, runs = _program(seed, number)
    felt = draw_air(float(rng.uniform(18.0, 25.0)), steps_of((Phase(REST_S), runs)), rng)
    phases = (Phase(REST_S), Phase(now_s - REST_S + SETTLED_S, runs.speed_rpm, runs.low_m, runs.high_m))
    at = round(now_s / STEP_s)
    held = np.concatenate([felt[: at + 1], np.full(steps_of(phases) - at, felt[at])])
    result = run_machine(one.machine.physics, build_schedule(phases, START_M, held), COARSE_M)
    return result.section_degC[:, ::2], error_along(result.section_degC - felt[0], COARSE_M)[:, ::2]


def error_along(rise_K: FloatArray, position_m: FloatArray) -> FloatArray:
    """The growth (n, g), µm, of a free screw from its left end by its rise (n, g), by trapezoids."""
    pieces = 0.5 * (rise_K[:, 1:] + rise_K[:, :-1]) * np.diff(position_m)
    return EXPANSION_um_K_m * np.hstack([np.zeros((len(rise_K), 1)), np.cumsum(pieces, axis=1)])


def settled(one: Specimen, seed: int, number: int, now_s: float) -> tuple[FloatArray, FloatArray, float]:
    """Where it truly settles, °C and µm, and how long after now the travel is within the limit of that."""
    field_degC, error_um = path(one, seed, number, now_s)
    last, at = slice(-round(120.0 / STEP_s), None), round(now_s / STEP_s)
    there_um = error_um[last].mean(axis=0)
    off = np.flatnonzero((np.abs(error_um[at:] - there_um) > WITHIN_UM).any(axis=1))
    after_s = (off[-1] + 1) * STEP_s if len(off) else 0.0
    return field_degC[last].mean(axis=0), there_um, float(after_s)


def forecasts(
    group: Group, one: Specimen, seed: int, number: int, hours: float = 1.0
) -> tuple[Forecast, Forecast, float]:
    """What is forecast from the whole log, from the live state, and at which time of the day."""
    text = CONFIG + group.more
    if group.is_calibrated:
        text = calibrated(text, the_day_before(one, seed, number, group.per_start))
    config, day = config_of(text), warming(one, seed, number)
    machine, bank = MachineModel.of(config, learns=True), FrictionBank(config)
    pipeline, moving = machine.pipeline(machine.estimator()), [m.index for m in machine.plant.moving]
    pipeline.gap = None
    parts, now_s = list[Bins](), 0.0
    for frames in frames_of_log(log_of(day), machine.plan, 60):
        block = pipeline.step(frames)
        parts.append(binned(pipeline.inputs, block, moving))
        bank.take(pipeline.inputs, block)
        now_s = float(block.time_s[-1] - day.time_s[0])
        if now_s >= REST_S + WARM_S:
            break
    program, state = learnt(joined(parts)), pipeline.snapshot()[1]
    live = [(1.0, runner(machine.plant, config.estimator, state, program))]
    by_log, by_live = (forecast(config, b, program, hours, WITHIN_UM) for b in (bank.begins(program), live))
    return by_log, by_live, now_s


def predicted(found: Forecast, field_degC: FloatArray, error_um: FloatArray) -> PredictedSettling:
    """Hold a forecast against the truth."""
    where, nothing = found.settled, np.full(len(field_degC), np.nan)
    sigma_K = nothing if where.field_sigma_K is None else where.field_sigma_K
    sigma_um = (nothing if where.error_sigma_um is None else where.error_sigma_um)[1:]
    off_K, off_um = where.field_degC - field_degC, (where.error_um - error_um)[1:]
    between_s = where.between_s or (np.nan, np.nan)
    return PredictedSettling(
        _rms(off_K), float(sigma_K.mean()), float(np.mean(np.abs(off_K) <= Z95 * sigma_K)),
        _rms(off_um), float(sigma_um.mean()), float(np.mean(np.abs(off_um) <= Z95 * sigma_um)),
        np.nan if where.after_s is None else where.after_s, *between_s,
    )  # fmt: skip


def _rms(values: FloatArray) -> float:
    return float(np.sqrt(np.mean(values**2)))


COLUMNS = ("group", "machine", "by", *PredictedSettling._fields, "true_s")


def warmed(seed: int, task: tuple[str, int]) -> list[dict[str, str]]:
    """One machine's rows, from the whole log and from the live state."""
    name, number = task
    group = GROUPS[name]
    one = draw(seed, number, group.rough)
    whole, live, now_s = forecasts(group, one, seed, number)
    field_degC, error_um, true_s = settled(one, seed, number, now_s)
    rows = []
    for by, found in (("log", whole), ("live", live)):
        cells = [f"{value:.3f}" for value in (*predicted(found, field_degC, error_um), true_s)]
        rows.append(dict(zip(COLUMNS, (name, str(number), by, *cells), strict=True)))
    return rows


def table(rows: Sequence[Mapping[str, str]]) -> str:
    """A line for each group and way."""
    lines = [
        "| machines | forecast from | number | settled field: off | σ | 95 % hold | thermal error: off | σ "
        "| 95 % hold | when: off | 95 % hold | band, median |",
        "|---|---|---|---|---|---|---|---|---|---|---|---|",
    ]
    for name in GROUPS:
        for by, words in (("log", "the log"), ("live", "the live state")):
            own = [row for row in rows if row["group"] == name and row["by"] == by]
            if not own:
                continue
            a = {c: np.array([float(row[c]) for row in own]) for c in COLUMNS[3:]}
            off_min = (a["said_s"] - a["true_s"]) / 60.0
            held = (a["from_s"] <= a["true_s"] + 30.0) & (a["true_s"] - 30.0 <= a["to_s"])
            lines.append(
                f"| {name} | {words} | {len(own)} | {_rms(a['off_K']):.2f} K | {a['sigma_K'].mean():.2f} K "
                f"| {100 * a['held_field'].mean():.0f} % | {_rms(a['off_um']):.1f} µm "
                f"| {a['sigma_um'].mean():.1f} µm | {100 * a['held_error'].mean():.0f} % "
                f"| {_rms(off_min):.0f} min | {100 * held.mean():.0f} % "
                f"| {np.median(a['to_s'] - a['from_s']) / 60.0:.0f} min |"
            )
    return "\n".join(lines)
