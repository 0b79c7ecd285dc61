"""Tolerances, gaps of a log, and bounds inside every hypothesis."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from observer.config.effects.base import Unnamed
from observer.config.effects.bodies import EndConduction
from observer.config.effects.terms import AmbientShift, SensorOffset
from observer.config.machine import Config
from observer.discovery.candidates import library, promises, signatures
from observer.discovery.search import tried
from observer.fit.forward import Forward
from observer.fit.hypothesis import fit_effects, fit_null
from observer.fit.linear import LinearFit
from observer.fit.parameters import replaced
from observer.fit.problem import Problem
from observer.frames import FloatArray, FrameBlock
from observer.model.build import build_plant
from observer.model.drive import Drive
from observer.model.simulate import simulate, start
from tests.discovery.small import problem_of
from tests.logs.machines import machine, table
from tests.logs.simulated import made_log


def most_probable(T: FloatArray, residual: FloatArray, most: FloatArray) -> FloatArray:
    """Tolerances of variance 1 within their limits."""
    return LinearFit.of(T, residual, prior_weight=1.0).bounded_step(-most, most)


@pytest.mark.parametrize(("off_sigma", "taken"), [(1.0, 0.99), (2.9, 2.87), (13.0, 3.0), (-13.0, -3.0)])
def test_a_tolerance_explains_no_more_than_its_limit(off_sigma: float, taken: float) -> None:
    column = np.full((100, 1), 1.0)
    found = most_probable(column, off_sigma * column[:, 0], np.array([3.0]))
    assert found == pytest.approx([taken], abs=0.002)


def test_what_one_tolerance_may_not_explain_falls_to_others() -> None:
    """Of two columns much alike one is limited: the other takes over as far as it may."""
    T, residual = np.array([[10.0, 9.0], [0.0, 5.0], [0.0, 0.0]]), np.array([50.0, 0.0, 0.0])
    free, held = (most_probable(T, residual, np.array([most, 99.0])) for most in (99.0, 3.0))
    assert free[0] > 3.0
    assert held[0] == pytest.approx(3.0)
    slope = T.T @ (residual - T @ held) - held  # the second is where its own derivative is zero
    assert held[1] > free[1]
    assert slope[1] == pytest.approx(0.0, abs=1e-6)


# ---- gaps ----


def with_gap(log: FrameBlock, from_s: float, to_s: float) -> FrameBlock:
    """The log without the rows of some minutes."""
    kept = (log.time_s < from_s) | (log.time_s > to_s)
    rows = {key: getattr(log, key)[kept] for key in ("time_s", "values", "fresh", "quality", "age_s")}
    return replace(log, dt_s=np.diff(rows["time_s"], prepend=rows["time_s"][0]), **rows)


def with_a_secret(config: Config, from_s: float, to_s: float) -> FrameBlock:
    """The log of a machine whose heater was off for some minutes, though the log says it was on."""
    log = made_log(config, 1, minutes=60.0)
    heater, secretly = config.channels.index("heater_W"), (log.time_s >= from_s) & (log.time_s <= to_s)
    assert log.values[secretly, heater].min() > 0.0
    true = log.values.copy()
    true[secretly, heater] = 0.0
    plant = build_plant(config)
    drive = Drive(config, plant)
    logged, was = (drive.run(drive.initial(), replace(log, values=v))[1] for v in (log.values, true))
    state = start(plant, 20.0, logged.law_W[0])
    less_K = simulate(plant, state, was)[1] - simulate(plant, state, logged)[1]
    values = log.values.copy()
    for i, sensor in enumerate(config.sensor):
        values[:, config.channels.index(sensor.channel)] += less_K[:, i]
    return replace(log, values=values)


def test_what_a_machine_did_in_a_gap_is_nobodys_fault() -> None:
    config = machine()
    log = with_a_secret(config, 1000.0, 1500.0)
    problem = problem_of(config, [with_gap(log, 1000.0, 1500.0)])
    used = problem.evidence.used
    fit = fit_null(problem, config)
    honest = fit_null(
        problem_of(config, [with_gap(made_log(config, 1, minutes=60.0), 1000.0, 1500.0)]), config
    )
    bare = float(np.sum(problem.residual(config)[used] ** 2))
    print(f"deviance {fit.deviance:.0f}, without a secret {honest.deviance:.0f}, bare {bare:.0f}")
    assert bare > 100 * honest.deviance
    # the tick that holds the gap lasts some seconds longer, so its heat is not that of the gap alone
    assert fit.deviance < 2 * honest.deviance
    whole = problem_of(config, [log])  # the same where nothing is missing is not forgiven
    assert fit_null(whole, config).deviance / np.count_nonzero(whole.evidence.used) > 10.0


def test_a_heat_may_have_been_anywhere_and_late_in_a_gap() -> None:
    """The heater stood elsewhere for the second half of a gap: neither a source as it is nor an even heat."""
    config = machine()
    moved = [{"name": "moved", "shape": "band", "from_m": 0.25, "to_m": 0.3, "power_channel": "heater_W"}]
    other = machine(source=[*moved, *table()["source"][1:]])
    log, gap_s = made_log(config, 1, minutes=60.0), (900.0, 1500.0)
    late = (log.time_s >= 1200.0) & (log.time_s <= gap_s[1])
    change_K = np.zeros((len(log), len(config.sensor)))
    for machine_, sign in ((other, 1.0), (config, -1.0)):
        own = replace(log, values=log.values.copy())
        own.values[~late, config.channels.index("heater_W")] = 0.0
        plant = build_plant(machine_)
        drive = Drive(machine_, plant)
        inputs = drive.run(drive.initial(), own)[1]
        change_K += (
            sign * simulate(plant, start(plant, 20.0, inputs.law_W[0]), inputs)[1][:, : change_K.shape[1]]
        )
    for i, sensor in enumerate(config.sensor):
        log.values[:, config.channels.index(sensor.channel)] += change_K[:, i]
    problem = problem_of(config, [with_gap(log, *gap_s)])
    honest = fit_null(problem_of(config, [with_gap(made_log(config, 1, minutes=60.0), *gap_s)]), config)
    fit = fit_null(problem, config)
    most_K = np.abs(change_K).max()
    print(f"deviance {fit.deviance:.0f}, without a secret {honest.deviance:.0f}, up to {most_K:.1f} K")
    assert most_K > 5.0
    assert fit.deviance < 2 * honest.deviance


def test_a_log_without_gaps_needs_no_tolerance_for_them() -> None:
    config = machine()
    problem = problem_of(config, [made_log(config, 1, minutes=30.0)])
    assert problem.forward.by_outages(config) == []
    gapped = problem_of(config, [with_gap(made_log(config, 1, minutes=30.0), 600.0, 700.0)])
    changes = gapped.forward.by_outages(config)
    assert len(changes) >= len(config.sensor)
    before = gapped.forward.runs[0].ticks.time_s <= 600.0
    assert all(np.all(run[before] == 0.0) for change in changes for run in change)
    assert all(np.any(run != 0.0) for change in changes for run in change)


# ---- bounds ----


def test_a_free_parameter_stays_within_its_bounds() -> None:
    """A machine whose bearing cools its end would need a negative heat."""
    config = replaced(machine(), {"source.bearing.l.heat_W_rpm": 0.0})
    truth = machine(effect=[{"kind": "end_heat", "target": "right", "heat_W_rpm": -0.004}])
    truth = replaced(truth, {"source.bearing.l.heat_W_rpm": 0.0})
    free = config.model_copy(
        update={"calibrate": config.calibrate.model_copy(update={"free": ("source.bearing.l.heat_W_rpm",)})}
    )
    problem = problem_of(free, [made_log(truth, seed, minutes=60.0) for seed in range(3)])
    fit = fit_null(problem, free)
    (value,) = problem.free_values(fit.config)
    assert value == 0.0
    beyond = problem.with_free(free, np.array([-1.0]))
    assert problem.free_values(beyond).tolist() == [0.0]


def test_an_effect_at_its_bound_is_not_accepted() -> None:
    """Less loss than is modelled cannot be a negative conductance."""
    config = machine(boundary={"right": {"kind": "convective", "coefficient_W_m2K": 300.0}})
    problem = problem_of(config, [made_log(machine(), seed, minutes=60.0) for seed in range(3)])
    null = fit_null(problem, config)
    [candidate] = [c for c in library(config, problem.keys) if c.name == "end_conduction at right"]
    found = signatures(problem, null.config, [candidate])
    (promise,) = promises(null, found)
    assert promise.strength == 0.0
    assert tried(null, null, found, ()) == ()
    start = EndConduction(kind="end_conduction", target="right", conductance_W_K=0.05)
    fit = fit_effects(problem, null.config.model_copy(update={"effect": (start,)}), candidate.parameters(0))
    assert fit.values.tolist() == [0.0]
    assert fit.at_bound


# ---- gain, timing, heats from log to log ----


EXACT = {
    "conductivity": 0.0, "heat_capacity": 0.0, "position_m": 0.0, "lag_s": 0.0, "offset_K": 0.0,
    "ambient_K": 0.0,
}  # fmt: skip


def cost_of(logs: list[FrameBlock], **known: float) -> float:
    config = machine(tolerance=EXACT | {"gain": 0.0, "heat_per_log": 0.0} | known, calibrate={"free": FILM})
    return fit_null(problem_of(config, logs), config).deviance


FILM = ["surface.convection_W_m2K"]


def logs_of(truth: Config) -> list[FrameBlock]:
    return [made_log(truth, seed, minutes=60.0) for seed in range(2)]


def toward_the_air() -> list[FrameBlock]:
    logs = logs_of(machine())
    for log in logs:
        for name, part in (("a_degC", 0.02), ("b_degC", -0.02), ("c_degC", 0.02)):
            column = log.values[:, log.channels.index(name)]
            column -= part * (column - 20.0)
    return logs


def one_heat_3_percent_more() -> list[FrameBlock]:
    logs = logs_of(machine())
    logs[0].values[:, logs[0].channels.index("heater_W")] /= 1.03
    return logs


def conducting(sigmas: float = 1.0) -> list[FrameBlock]:
    return logs_of(replaced(machine(), {"screw.conductivity_W_mK": 50.0 * (1.0 + 0.02 * sigmas)}))


def with_offset_and_air() -> list[FrameBlock]:
    more = (SensorOffset("b", 0.3, 0.0), AmbientShift(0.0, 0.5))
    return logs_of(machine().model_copy(update={"effect": (Unnamed(more),)}))


@pytest.mark.parametrize(
    ("logs", "known", "share", "exact"),
    [
        (toward_the_air, {"gain": 0.02}, 3.0, 100.0),
        (one_heat_3_percent_more, {"heat_per_log": 0.03}, 1.0, 50.0),
        (conducting, {"conductivity": 0.02}, 1.0, 10.0),
        (with_offset_and_air, {"offset_K": 0.3, "ambient_K": 0.5}, 3.0, 100.0),
    ],
    ids=["gain", "heat", "conductivity", "offset and air"],
)
def test_what_is_off_within_its_tolerance_costs_its_own_share(
    logs: Callable[[], list[FrameBlock]], known: dict[str, float], share: float, exact: float
) -> None:
    """One for each standard deviation, and the fit's own chance; much more where it is taken as exact."""
    honest = cost_of(logs_of(machine()), **known)
    assert cost_of(logs(), **known) < honest + share + 10.0
    assert cost_of(logs()) > honest + exact


def test_what_is_off_far_beyond_its_tolerance_is_something() -> None:
    honest = cost_of(logs_of(machine()), conductivity=0.02)
    assert cost_of(conducting(15.0), conductivity=0.02) > honest + 50.0


def test_of_a_single_log_no_heat_differs_from_that_of_another() -> None:
    log = one_heat_3_percent_more()[:1]
    assert cost_of(log, heat_per_log=0.03) == pytest.approx(cost_of(log))


def thinned(log: FrameBlock, rows: int) -> FrameBlock:
    """Every so many rows of a log."""
    kept = {
        key: getattr(log, key)[::rows].copy() for key in ("time_s", "values", "fresh", "quality", "age_s")
    }
    return replace(log, dt_s=np.diff(kept["time_s"], prepend=kept["time_s"][0]), **kept)


def test_rows_a_minute_apart_do_not_show_when_a_heat_changed(monkeypatch: pytest.MonkeyPatch) -> None:
    """Heats that are recorded half of a row late, as where a recorder holds what it is taken to ramp to."""
    config = machine()
    logs = [made_log(config, seed, minutes=60.0) for seed in range(2)]
    honest = cost_of([thinned(log, 30) for log in logs])
    for log in logs:
        for name in ("heater_W", "n_rpm"):
            column = log.values[:, config.channels.index(name)]
            column[15:] = column[:-15].copy()
    late = [thinned(log, 30) for log in logs]
    allowed = cost_of(late)
    monkeypatch.setattr(Forward, "by_coarse_rows", lambda *_: [])
    monkeypatch.setattr(Problem, "by_timing", lambda *_: [])
    strict = cost_of(late)
    print(honest, allowed, strict)
    assert allowed < honest + 30.0  # a shift of one σ, and four heats that changed by √3 σ each
    assert strict > allowed + 200.0
