"""Where a plant settles, by one solve, against closed forms that share no code with it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.optimize import brentq

from observer.config.machine import Config
from observer.errors import ConfigError
from observer.files.logs import Log, log_of
from observer.frames import FloatArray
from observer.installation import load
from observer.library.predicting import simulated_run
from observer.library.steady import steady_screw
from observer.model.build import build_plant
from observer.model.drive import Drive
from observer.model.plant import Plant
from observer.model.rod.screw import surface_film_W_m2K, surface_rate
from observer.model.settle import mean_point, needed_channels, point_of, settled
from tests.logs.simulated import frames
from tests.reference.cases import config_of, point
from tests.truth import closed_forms, kuznetsov, yu
from tests.truth.bar import Bar, End

BAR = Bar(length_m=0.6, diameter_m=0.03, convection_W_m2K=12.0)
GRID_M = np.array([0.0, 0.01, 0.05, 0.2, 0.33, 0.5, 0.6])
BOTH = [point("left", 0.0), point("right", BAR.length_m)]
CONFIG = Path(__file__).parents[2] / "config"
HEATS = {"left_W": 6.0, "right_W": 9.0, "ambient_degC": 0.0}
FEW = {"modes": 8}


def at_rest(config: Config, values: dict[str, float]) -> tuple[Plant, FloatArray]:
    """The plant, and its output rows where it settles."""
    plant = build_plant(config)
    return plant, settled(plant, point_of(config, plant, values)).rows


@pytest.mark.parametrize(("first", "second"), [(2e8, 5e7), (1e9, 3e8), (3e7, 1e10)])
def test_a_screw_between_supports_settles_on_kuznetsovs_displacement(first: float, second: float) -> None:
    supports = {"mounting": "L-III", "stiffness_first_N_m": first, "stiffness_second_N_m": second}
    output = {"positions_m": GRID_M.tolist(), "reference_degC": 0.0}
    config = config_of(BAR, BOTH, GRID_M, supports=supports, model=FEW, output=output)
    plant, rows = at_rest(config, HEATS)
    printed = kuznetsov.steady_displacement_um(BAR, (6.0, 9.0), (first, second), 2.06e11, GRID_M)
    np.testing.assert_allclose(plant.rows.error_um(rows[None])[0], printed, rtol=0, atol=1e-7)


def test_a_screw_between_known_ends_settles_on_yus_exponentials() -> None:
    ends = (End("prescribed"), End("prescribed"))
    config = config_of(BAR, [point("idle", 0.3)], GRID_M, ends=ends, model=FEW)
    values = {"idle_W": 0.0, "left_degC": 28.0, "right_degC": 23.0, "ambient_degC": 20.0}
    plant, rows = at_rest(config, values)
    wanted = 20.0 + yu.steady(BAR, 8.0, 3.0, GRID_M)
    np.testing.assert_allclose(rows[plant.rows.field_slice], wanted, rtol=0, atol=1e-9)


def test_a_loss_of_the_speed_settles_as_a_film_that_is_always_there() -> None:
    own_W_K = 12.0 * np.pi * BAR.diameter_m * BAR.length_m
    coolant = {"kind": "coolant", "conductance_W_K": own_W_K, "inlet_degC": 0.0, "speed_channel": "n_rpm"}
    plant, rows = at_rest(
        config_of(BAR, BOTH, GRID_M, effect=[coolant], model={"modes": 100}), HEATS | {"n_rpm": 500.0}
    )
    wet = replace(BAR, convection_W_m2K=24.0)
    truth = sum(
        closed_forms.steady_fin(wet, (End(), End()), x, q, GRID_M) for x, q in ((0.0, 6.0), (0.6, 9.0))
    )
    # the modes that are dropped do not know of the loss: the 101st is 100² times as fast as the film
    np.testing.assert_allclose(rows[plant.rows.field_slice], truth, rtol=0, atol=1e-3)


def radiated_W_m2(T_degC: float) -> float:
    return float(0.8 * 5.670374e-8 * ((T_degC + 273.15) ** 4 - 293.15**4))


def into_still_air_W_m2(T_degC: float) -> float:
    return float(6.0 * ((T_degC - 20.0) / 10.0) ** 0.25 * (T_degC - 20.0))


@pytest.mark.parametrize(
    ("effect", "loss_W_m2"),
    [
        ({"kind": "radiation", "emissivity": 0.8}, radiated_W_m2),
        ({"kind": "natural_convection", "coefficient_W_m2K": 6.0}, into_still_air_W_m2),
    ],
)
def test_a_loss_that_grows_and_friction_that_fades_balance_as_in_a_lump(
    effect: dict[str, Any], loss_W_m2: Callable[[float], float]
) -> None:
    lump = Bar(length_m=0.05, diameter_m=0.03, conductivity_W_mK=400.0, convection_W_m2K=8.0)
    fade = {"kind": "friction_fade", "target": "left", "per_K": 0.02, "reference_degC": 20.0}
    tables: dict[str, Any] = {"effect": [effect, fade], "model": {"modes": 40}}
    config = config_of(lump, [point("left", 0.0)], np.array([0.0, 0.025, 0.05]), sensor_m=(0.025,), **tables)
    plant = build_plant(config)
    found = settled(plant, point_of(config, plant, {"left_W": 6.0, "ambient_degC": 20.0}))
    area_m2 = np.pi * lump.diameter_m * lump.length_m

    def missing_W(T_degC: float) -> float:
        lost_W = area_m2 * (8.0 * (T_degC - 20.0) + loss_W_m2(T_degC))
        return 6.0 * float(np.exp(-0.02 * (T_degC - 20.0))) - lost_W

    lump_degC = brentq(missing_W, 20.0, 200.0)
    middle_degC = found.rows[plant.rows.sensors + 1]
    # the lump is even to q L/(2 k A) = 0.2 K, of which the friction feels a fiftieth per kelvin
    assert abs(middle_degC - lump_degC) < 0.2
    fin = replace(lump, convection_W_m2K=found.heat_W[0] / area_m2 / (lump_degC - 20.0))
    spread_K = closed_forms.steady_fin(
        fin, (End(), End()), 0.0, float(found.heat_W[0]), np.array([0.0, 0.05])
    )
    ends_degC = found.rows[plant.rows.field_slice][[0, 2]]
    assert ends_degC[0] - ends_degC[1] == pytest.approx(spread_K[0] - spread_K[1], rel=0.01)


def test_no_steady_state_is_said_in_a_sentence() -> None:
    config = config_of(replace(BAR, convection_W_m2K=0.0), BOTH, GRID_M, model=FEW)
    with pytest.raises(ConfigError, match="nothing takes the heat away"):
        at_rest(config, HEATS)
    drift = {"kind": "ambient_drift", "rate_K_h": 0.5}
    with pytest.raises(ConfigError, match="drift"):
        at_rest(config_of(BAR, BOTH, GRID_M, effect=[drift]), HEATS)
    with pytest.raises(ConfigError, match="needs a value of left_W, right_W"):
        at_rest(config_of(BAR, BOTH, GRID_M), {"ambient_degC": 20.0})


def test_nodes_of_yus_drive_balance_and_lose_all_heat_to_the_air() -> None:
    """What the links to the ambient and the film of the screw carry is what the sources give."""
    config = load(CONFIG / "yu-dual-drive.toml")
    inputs = {"screw_speed_rpm": 216.0, "nut_speed_rpm": 180.0, "t4_degC": 25.0}
    fine = config.model_copy(
        update={"output": config.output.model_copy(update={"positions_m": tuple(np.linspace(0, 0.34, 201))})}
    )
    found = steady_screw(fine, inputs, None).figures
    nodes_W = 0.0
    for link in config.link:
        if "ambient" in link.between:
            node = next(end for end in link.between if end != "ambient")
            nodes_W += link.film_W_m2K * link.area_m2 * (found.temperature_degC[node] - 25.0)
    plant = build_plant(config)
    point_there = point_of(config, plant, inputs)
    natural_W_m2K = surface_film_W_m2K(config.surface, config.screw.diameter_m)
    turning_W_m2K = point_there.loss_1_s / surface_rate(config.screw)
    rise_K_m = np.trapezoid(found.field_degC - 25.0, found.position_m)
    screw_W = (natural_W_m2K + turning_W_m2K) * np.pi * config.screw.diameter_m * rise_K_m
    # Simpson's rule would do better than the trapezium over 201 places, which is off by 1e-4 of it
    assert nodes_W + screw_W == pytest.approx(sum(found.heat_W.values()), rel=1e-3)


def test_the_mean_of_a_program_is_where_its_repetition_settles_on_average() -> None:
    config = config_of(BAR, BOTH, GRID_M, model=FEW)
    plant = build_plant(config)
    time_s = np.arange(0.0, 4000.0, 10.0)
    left_W = np.where(time_s % 400.0 < 100.0, 24.0, 0.0)
    columns = {"left_W": left_W, "right_W": np.full_like(time_s, 9.0), "ambient_degC": np.zeros_like(time_s)}
    block = frames(config, time_s, columns | {"t1_degC": np.full_like(time_s, np.nan)})
    _, inputs = Drive(config, plant).run(Drive(config, plant).initial(), block)
    found = settled(plant, mean_point(plant, [inputs])).rows
    truth = settled(
        plant, point_of(config, plant, HEATS | {"left_W": float(inputs.law_W[1:, 0].mean())})
    ).rows
    np.testing.assert_allclose(found, truth, rtol=0, atol=1e-9)


def test_a_nut_stands_at_a_given_position_or_runs_over_its_stroke() -> None:
    nut = {"name": "nut", "shape": "nut", "length_m": 0.06, "stroke_m": [0.1, 0.5], "power_channel": "nut_W"}
    config = config_of(BAR, [nut | {"position_channel": "x_m"}], GRID_M, model={"modes": 30})
    assert needed_channels(config) == ("nut_W", "ambient_degC")
    values = {"nut_W": 10.0, "ambient_degC": 0.0}
    plant, stands = at_rest(config, values | {"x_m": 0.3})
    band = closed_forms.steady_fin_band(BAR, (End(), End()), 0.27, 0.33, 10.0, GRID_M)
    # between two places of its table the lag's column is interpolated
    np.testing.assert_allclose(stands[plant.rows.field_slice], band, rtol=0, atol=2e-3)
    _, runs = at_rest(config, values)
    assert runs[plant.rows.field_slice][4] < stands[plant.rows.field_slice][4]
    assert runs[plant.rows.field_slice][0] > stands[plant.rows.field_slice][0]


TOUCHED = {
    "node": [{"name": "body", "capacity_J_K": 300.0}],
    "link": [
        {"between": ["body", "nut"], "conductance_W_K": 2.0},
        {"between": ["body", "ambient"], "conductance_W_K": 0.3},
    ],
}


@pytest.mark.parametrize(
    ("sweep_m", "most_K"),
    [
        # steps of 10 s, and couplings of a nut are of second order in these
        ((0.3, 0.3), 0.005),
        ((0.14, 0.14), 0.005),
        # what the nut exchanges as it sweeps is taken by the mean of its footprint
        ((0.1, 0.5), 0.05),
    ],
)
def test_a_nut_that_passes_heat_to_a_body_settles_as_a_long_run_does(
    sweep_m: tuple[float, float], most_K: float
) -> None:
    nut = {"name": "nut", "shape": "nut", "length_m": 0.06, "stroke_m": [0.1, 0.5], "heat_W": 20.0}
    config = config_of(
        BAR,
        [nut | {"position_channel": "x_m", "nodes": {"body": 0.5}}],
        GRID_M,
        model={"modes": 30},
        **TOUCHED,
    )
    low_m, high_m = sweep_m
    time_s = np.arange(0.0, 20_000.0, 2.0 if high_m > low_m else 10.0)
    x_m = low_m + (high_m - low_m) * np.abs((time_s / 20.0) % 2.0 - 1.0)
    program = log_of({"time_s": time_s, "x_m": x_m, "ambient_degC": np.full_like(time_s, 20.0)})
    late = long_run(config, program)
    by_mean = steady_screw(config, {}, program).figures
    np.testing.assert_allclose(by_mean.field_degC, late, rtol=0, atol=most_K)
    if low_m == high_m:
        placed = steady_screw(config, {"x_m": low_m, "ambient_degC": 20.0}, None).figures
        np.testing.assert_allclose(placed.field_degC, late, rtol=0, atol=most_K)


def long_run(config: Config, program: Log) -> FloatArray:
    """The mean field of the last part of a run that repeats itself."""
    run = simulated_run(program, config, None, lambda _done, _total: None)
    return np.array([run[f"field_{1000.0 * x:.10g}_degC"][-400:].mean() for x in GRID_M])


def test_a_nut_that_rubs_in_one_part_of_its_travel_heats_the_screw_there() -> None:
    nut = {"name": "nut", "shape": "nut", "length_m": 0.06, "stroke_m": [0.1, 0.5], "heat_W": 20.0}
    nut |= {"position_channel": "x_m", "drive_channel": "on"}
    config = config_of(BAR, [nut], GRID_M, model={"modes": 30})
    time_s = np.arange(0.0, 20_000.0, 2.0)
    x_m = 0.1 + 0.4 * np.abs((time_s / 20.0) % 2.0 - 1.0)
    air = np.full_like(time_s, 20.0)
    program = log_of({"time_s": time_s, "x_m": x_m, "on": (x_m < 0.2).astype(float), "ambient_degC": air})
    found = steady_screw(config, {}, program).figures.field_degC
    assert found[2] - found[5] > 5.0
    # the path within a step of 2 s, a tenth of the way, smears where the heat begins
    np.testing.assert_allclose(found, long_run(config, program), rtol=0, atol=0.2)


@pytest.mark.parametrize(
    "effect",
    [
        {"kind": "radiation", "emissivity": 1.0},
        {"kind": "natural_convection", "coefficient_W_m2K": 4.0},
    ],
)
def test_a_loss_that_grows_is_that_of_a_field_and_not_of_its_mean(effect: dict[str, Any]) -> None:
    poor = replace(BAR, conductivity_W_mK=15.0, convection_W_m2K=2.0)
    config = config_of(poor, BOTH, GRID_M, effect=[effect], model={"modes": 40})
    time_s = np.arange(0.0, 60_000.0, 10.0)
    columns = {"left_W": 8.0, "right_W": 0.0, "ambient_degC": 20.0}
    program = log_of({"time_s": time_s, **{name: np.full_like(time_s, v) for name, v in columns.items()}})
    found = steady_screw(config, columns, None).figures.field_degC
    assert np.ptp(found) > 60.0  # the losses take half steps, so that the run is off by the square of 10 s
    np.testing.assert_allclose(found, long_run(config, program), rtol=0, atol=0.02)


def test_a_log_of_constant_inputs_is_the_state_of_these() -> None:
    coolant = {"kind": "coolant", "conductance_W_K": 0.5, "inlet_degC": 12.0, "speed_channel": "n_rpm"}
    config = config_of(BAR, BOTH, GRID_M, effect=[coolant], model=FEW)
    time_s, values = np.arange(0.0, 100.0, 10.0), HEATS | {"n_rpm": 500.0}
    program = log_of({"time_s": time_s, **{name: np.full_like(time_s, v) for name, v in values.items()}})
    given, meant = (steady_screw(config, *by).figures.field_degC for by in ((values, None), ({}, program)))
    np.testing.assert_allclose(meant, given, rtol=0, atol=1e-9)
