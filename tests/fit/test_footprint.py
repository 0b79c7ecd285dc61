"""What a search makes of a nut's path in ticks of ten seconds, against the path followed row by row."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from observer.align.aligner import AlignPlan, frames_of_log
from observer.config.effects.base import EffectTable
from observer.config.effects.bodies import AttachedMass, EndConduction
from observer.config.effects.heat import Dwell
from observer.config.effects.sensing import SensorLag
from observer.config.machine import Config
from observer.config.screw import ScrewSection
from observer.files.logs import read_log
from observer.fit.forward import Forward, lean_config
from observer.fit.runs import Run, means_of, prepare
from observer.fit.steps import PLACES, SteppedRun, interpolation, swept
from observer.frames import FloatArray
from observer.model.build import build_plant
from observer.model.plant import Plant
from observer.model.rod import moving
from observer.model.simulate import simulate_means
from tests.logs.machines import RIG, rig
from tests.logs.simulated import simulated_rows

MODES = 20


def with_effects(*effects: EffectTable) -> Config:
    return lean_config(rig()[0].model_copy(update={"effect": effects}), MODES)


JOURNAL = ScrewSection(from_m=0.0, to_m=0.3, diameter_m=0.025)
AT_LEFT = AttachedMass(kind="attached_mass", target="left", capacity_J_K=300.0, conductance_W_K=2.0)


def stepped(config: Config) -> Config:
    """The same screw with a journal as long as the nut reaches."""
    return config.model_copy(update={"screw": config.screw.model_copy(update={"section": (JOURNAL,)})})


def the_run() -> Run:
    return prepare(rig()[0], rig()[1], "the rig's log")


def means_by_row(run: SteppedRun, rows: FloatArray) -> FloatArray:
    """The mean of each sensor's rows over each of a run's means, without rows that are no number."""
    ticks, there = run.ticks, np.isfinite(rows)
    mean = ticks.mean[np.repeat(np.arange(len(ticks.first)), np.diff([*ticks.first, len(rows)]))]
    total, count = np.zeros((2, mean[-1] + 1, rows.shape[1]))
    np.add.at(total, mean, np.where(there, rows, 0.0))
    np.add.at(count, mean, there)
    return total / count


def averaged(run: SteppedRun, plant: Plant, weight: FloatArray) -> FloatArray:
    """The nut's columns row by row, then averaged over the ticks, (T, N)."""
    frames, first, nut = run.run.frames, run.ticks.first, plant.moving[0]
    rows = moving.columns(nut.table, moving.start(nut.table), frames.dt_s, frames.path[nut.channel])[1]
    over = np.add.reduceat(weight, first)[:, None]
    return np.asarray(np.add.reduceat(rows[:, : plant.modes] * weight[:, None], first) / over)


@pytest.mark.parametrize("shaped", [Config.model_copy, stepped], ids=["uniform", "stepped"])
@pytest.mark.parametrize(
    "effects",
    [(), (EndConduction(kind="end_conduction", target="left", conductance_W_K=4.0),)],
    ids=["insulated", "lossy"],
)
def test_columns_of_any_modes_are_those_of_the_path_followed_row_by_row(
    effects: tuple[EffectTable, ...], shaped: Callable[[Config], Config]
) -> None:
    """The table is made with the modes of the rig as it is, and asked for those of another end."""
    own = shaped(with_effects())
    run = SteppedRun(the_run(), own, build_plant(own))
    config = shaped(with_effects(*effects))
    plant = build_plant(config)
    inputs = run.inputs(config, plant, "", "")
    count = np.diff([*run.ticks.first, len(run.run.frames)])
    weight = run.run.frames.dt_s * (np.repeat(np.abs(inputs.law_W[:, 0]), count) + 1e-6)
    direct = averaged(run, plant, weight)
    error = np.abs(inputs.moving_B[:, 0, : plant.modes] - direct).max() / np.abs(direct).max()
    print(f"{error:.1e} of the largest")
    assert error < 1e-5  # eight neighbours at a step of π/4L


def test_interpolates_polynomials_exactly() -> None:
    place = np.array([0.0, 0.3, 7.0, 11.8, 15.0])
    weights = interpolation(place, 16)
    x = np.arange(16) / 16
    for power in range(8):
        assert x**power @ weights == pytest.approx((place / 16) ** power, abs=1e-12)


def test_the_shapes_swept_make_up_the_covariance_of_all_places_under_a_nut() -> None:
    """A nut that goes evenly over 0.1 m in a tick covers places with the variances of both lengths."""
    config = with_effects()
    plant = build_plant(config)
    table = plant.moving[0].table
    places_m, centre_m = np.linspace(0.0, table.screw_m, PLACES), table.screw_m / 2
    way_m = np.linspace(centre_m - 0.05, centre_m + 0.05, 1001)
    apart_m = places_m[1]
    present = np.maximum(1.0 - np.abs(way_m[:, None] - places_m) / apart_m, 0.0).mean(axis=0)[None]
    shapes = np.empty((1, PLACES, plant.modes))
    swept(plant, table, present, shapes)
    point = replace(table, nut_m=1e-6)
    slope = [moving.columns_at(point, [x])[0][:2] for x in (centre_m - 1e-3, centre_m + 1e-3)]
    per_m = (slope[1] - slope[0])[1] / 2e-3  # the second mode is about straight in the middle
    variance_m2 = (shapes[0].T @ shapes[0])[1, 1] / per_m**2
    assert table.nut_m > 0.03
    assert variance_m2 == pytest.approx((0.1**2 + table.nut_m**2) / 12, rel=0.1)


@pytest.mark.parametrize("shaped", [Config.model_copy, stepped], ids=["uniform", "stepped"])
@pytest.mark.parametrize("beside", [(), (AT_LEFT,)], ids=["alone", "beside another"])
def test_a_strong_body_on_the_nut_is_predicted_in_ticks_as_row_by_row(
    beside: tuple[EffectTable, ...], shaped: Callable[[Config], Config]
) -> None:
    """What the body takes depends on where the nut has been within a tick, not on the mean place alone.

    Rows leave out what passes under the nut from place to place, so it is short.
    """
    body = AttachedMass(kind="attached_mass", target="nut", capacity_J_K=4000.0, conductance_W_K=5.0)
    config = shaped(with_effects(body, *beside))
    short = tuple(s.model_copy(update={"length_m": 0.01}) if s.shape == "nut" else s for s in config.source)
    config = config.model_copy(update={"source": short})
    forward = Forward(config, [the_run()])
    in_ticks = forward(config)[0]
    run = forward.runs[0]
    by_row = means_by_row(run, simulated_rows(config, run.run)[1])
    error_K, rise_K = np.sqrt(np.mean((in_ticks - by_row) ** 2)), np.ptp(by_row)
    print(f"{error_K:.4f} K of {rise_K:.1f} K")
    assert error_K < 1e-3 * rise_K  # by the mean place and the stroke: 3e-3


def test_a_pass_early_in_a_tick_warms_its_mean_by_more_than_one_late_in_it() -> None:
    """The means of rows are met twice as well as by mean heats alone, at the sensor passed most."""
    config, passed = with_effects(), 2
    plant = build_plant(config).sensors_only()
    run = SteppedRun(the_run(), config, plant)
    inputs = run.inputs(config, plant, "", "")
    state, rows = simulated_rows(config, run.run)
    steps = simulate_means(plant, state, inputs)
    exact = means_by_row(run, rows)[:, passed]
    passing, plain = (
        float(np.sqrt(np.mean((means[:, passed] - exact) ** 2)))
        for means in (run.means(plant, inputs, steps), means_of(run.ticks, steps, 0.0 * steps.ends))
    )
    print(f"{1e3 * passing:.1f} mK, without the passes {1e3 * plain:.1f} mK")
    assert passing < 0.6 * plain


@pytest.mark.parametrize("lag_s", [0.0, 4.0, 30.0])
@pytest.mark.parametrize("log", ["run_c.csv.gz", "null-0/run_a.csv.gz"], ids=["every row", "every 4th"])
def test_means_over_ticks_are_those_of_the_rows_however_a_sensor_lags(lag_s: float, log: str) -> None:
    """A lag bends a sensor's way within a tick, and values in every fourth row come later than its middle."""
    lags = [SensorLag(kind="sensor_lag", target="t3", time_constant_s=lag_s)] if lag_s else []
    config = with_effects(*lags)
    run = prepare(config, list(frames_of_log(read_log(RIG / log), AlignPlan.of(config))), log)
    forward, by_row = Forward(config, [run]), Forward(config, [run], tick_s=0.0)
    ticks = forward.runs[0].ticks
    rows = by_row._rows(by_row._setting(config), by_row.runs[0])[1].ends
    exact_degC = means_by_row(forward.runs[0], np.where(run.usable, rows, np.nan))
    error_K = forward(config)[0] - exact_degC
    rms_K, rise_K = np.sqrt(np.mean(error_K**2, axis=0)), np.ptp(ticks.measured_degC, axis=0)
    print(f"{1e3 * rms_K.round(6)} mK of {rise_K.round(1)} K")
    beyond = [0, 4]  # the nut does not pass them
    assert (rms_K[beyond] < 2e-5 * rise_K[beyond]).all()  # by the ends' means, in their middle: 2e-4
    assert (rms_K < 3e-4 * rise_K).all()


def test_dwelling_at_the_ends_follows_the_path_a_second_time() -> None:
    bare, config = with_effects(), with_effects(Dwell(kind="dwell", target="nut", fraction=0.5))
    run = SteppedRun(the_run(), bare, build_plant(bare))
    dwelling = run.inputs(config, build_plant(config), "", "").moving_B
    even = run.inputs(bare, build_plant(bare), "", "bare").moving_B
    assert np.abs(dwelling - even).max() > 0.1 * np.abs(even).max()
