"""The screw between its supports: as a chain of springs, at Kuznetsov's limits, and as estimators' rows."""

from __future__ import annotations

import math
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from scipy.optimize import brentq

import observer
from observer.config.machine import Config
from observer.config.mounting import Supports
from observer.config.screw import Screw
from observer.errors import ConfigError
from observer.estimators import build_estimator
from observer.files.logs import read_log
from observer.files.writer import write_log
from observer.frames import EstimateBlock, FloatArray
from observer.installation import parse
from observer.model.build import build_plant
from observer.model.drive import Drive
from observer.model.rod.supports import (
    Restraint,
    displacement_um,
    error_at,
    fold,
    force_N,
    restraint_of,
)
from observer.report.check import findings
from tests.logs.machines import table
from tests.logs.simulated import frames

LENGTH_M, DIAMETER_M, MODULUS_PA = 0.8, 0.03, 2.06e11
AREA_M2 = math.pi * DIAMETER_M**2 / 4
OWN_N_M = MODULUS_PA * AREA_M2 / LENGTH_M
GRID = np.linspace(0.0, LENGTH_M, 9)
LIII = {"mounting": "L-III"}


def restraint(**keys: Any) -> Restraint:
    screw = Screw(
        length_m=LENGTH_M, diameter_m=DIAMETER_M, conductivity_W_mK=50.0, density_kg_m3=7800.0,
        specific_heat_J_kgK=460.0,
    )  # fmt: skip
    return restraint_of(Supports.model_validate(keys), screw, GRID)


def displaced_um(held: Restraint, free_um: FloatArray) -> FloatArray:
    """U on the grid from the free growth on the grid, whose last point is the screw's end."""
    return displacement_um(held, free_um[None], free_um[-1:])[0]


stiffness = st.floats(1e6, 1e10)
preload = st.floats(0.0, 2e4)
gap = st.floats(0.0, 1e-4)
growth = st.floats(-60.0, 150.0)


def chain_of_springs(
    growth_um: float, first: float, second: float, preload_N: float, gap_m: float
) -> tuple[float, float, float]:
    """Force and both ends' displacements (N, µm, µm) where a chain of springs is in balance.

    Written from the balance of forces alone: the second support's pull on the screw's end is a falling
    function of where that end is; the screw and the first support follow it.
    """
    D = growth_um * 1e-6

    def pull_N(v: float) -> float:
        if v <= preload_N / second:
            return preload_N - second * v
        return -second * max(v - preload_N / second - gap_m, 0.0)

    def too_long_m(v: float) -> float:
        N = pull_N(v)
        return v - ((N - preload_N) / first + D + (N - preload_N) / OWN_N_M)

    v = brentq(too_long_m, -1e-2, 1e-2, xtol=1e-18, rtol=8.9e-16)
    N = pull_N(v)
    return N, 1e6 * (N - preload_N) / first, 1e6 * v


@given(growth_um=growth, first=stiffness, second=stiffness, preload_N=preload, gap_m=gap)
def test_supports_balance_like_a_chain_of_springs(
    growth_um: float, first: float, second: float, preload_N: float, gap_m: float
) -> None:
    held = restraint(
        **LIII, stiffness_first_N_m=first, stiffness_second_N_m=second, preload_N=preload_N, gap_m=gap_m
    )
    N, left_um, right_um = chain_of_springs(growth_um, first, second, preload_N, gap_m)
    moved = displaced_um(held, growth_um * GRID / LENGTH_M)
    # brentq's last bit of 1e-2 m, and its effect on the force through a stiffness of at most 1e10 N/m
    assert moved[0] == pytest.approx(left_um, abs=1e-6)
    assert moved[-1] == pytest.approx(right_um, abs=1e-6)
    assert force_N(held, np.array([growth_um]))[0] == pytest.approx(N, abs=1e-2, rel=1e-6)


@given(first=stiffness, second=stiffness, growth_um=growth)
def test_without_pretension_and_gap_it_is_kuznetsovs_twelfth_equation(
    first: float, second: float, growth_um: float
) -> None:
    free_um = growth_um * (GRID / LENGTH_M) ** 2
    total = 1 / (1 / first + 1 / second + 1 / OWN_N_M)
    printed = free_um - total * (1 / first + GRID / (MODULUS_PA * AREA_M2)) * free_um[-1]
    held = restraint(**LIII, stiffness_first_N_m=first, stiffness_second_N_m=second)
    np.testing.assert_allclose(displaced_um(held, free_um), printed, atol=1e-9)
    # his (14): the end moves by K_j = j_Σ/j_2 of the free growth
    assert displaced_um(held, free_um)[-1] == pytest.approx(total / second * growth_um, abs=1e-9)


def test_the_four_mountings_at_their_limits() -> None:
    free_um = np.linspace(0.0, 40.0, 9)
    by_mounting = {name: displaced_um(restraint(mounting=name), free_um) for name in ("L-I", "L-II", "L-IV")}
    np.testing.assert_array_equal(by_mounting["L-I"], free_um - 20.0)
    np.testing.assert_array_equal(by_mounting["L-II"], free_um)
    np.testing.assert_array_equal(by_mounting["L-IV"], free_um)
    rigid = displaced_um(restraint(**LIII), free_um**2)
    assert rigid[0] == 0.0
    assert rigid[-1] == pytest.approx(0.0, abs=1e-12)
    assert rigid[4] == pytest.approx(20.0**2 - 40.0**2 / 2)
    from_right = displaced_um(restraint(mounting="L-II", first="right"), free_um)
    np.testing.assert_array_equal(from_right, free_um - 40.0)


@pytest.mark.parametrize("more", [{}, {"preload_N": 300.0, "gap_m": 3e-6}, {"gap_m": 1.0}])
def test_a_mirrored_screw_moves_the_mirrored_way(more: dict[str, float]) -> None:
    stiff = {"stiffness_first_N_m": 3e8, "stiffness_second_N_m": 1e8} | more
    rise = np.array([3.0, 5.0, 7.0, 4.0, 2.0, 2.0, 1.0, 1.0])
    free_um, mirrored_um = (np.concatenate([[0.0], np.cumsum(r)]) for r in (rise, rise[::-1]))
    left = displaced_um(restraint(**LIII, **stiff), free_um)
    right = displaced_um(restraint(**LIII, **stiff, first="right"), mirrored_um)
    np.testing.assert_allclose(left, -right[::-1], atol=1e-12)


def test_a_stiffness_that_grows_without_end_is_a_rigid_one() -> None:
    free_um = np.linspace(0.0, 40.0, 9)
    stiff = restraint(**LIII, stiffness_first_N_m=1e16, stiffness_second_N_m=1e16)
    np.testing.assert_allclose(
        displaced_um(stiff, free_um), displaced_um(restraint(**LIII), free_um), atol=1e-5
    )


@pytest.mark.parametrize(
    ("supports", "sentence"),
    [
        ({}, "supports.mounting: is missing"),
        ({"mounting": "L-V"}, "supports.mounting: input should be"),
        ({"mounting": "L-II", "preload_N": 10.0}, 'preload_N has no effect in mounting = "L-II"'),
        ({"mounting": "L-III", "gap_m": -1.0}, "gap_m: input should be greater"),
    ],
)
def test_supports_that_cannot_be_are_refused(supports: dict[str, Any], sentence: str) -> None:
    with pytest.raises(ConfigError, match=sentence):
        machine(supports=supports)


def test_supports_need_an_expansion_coefficient() -> None:
    with pytest.raises(ConfigError, match="supports needs the screw's expansion coefficient"):
        parse(table(supports=LIII))


def machine(**tables: Any) -> Config:
    made = table(**tables)
    return parse(made | {"screw": made["screw"] | {"expansion_1_K": 11.8e-6}})


@cache
def block_of(engine: str, **supports: Any) -> EstimateBlock:
    """Estimates of a short run."""
    config = machine(estimator={"engine": engine}, **({"supports": supports} if supports else {}))
    time_s = np.arange(0.0, 1200.0, 2.0)
    warm = 20.0 + 12.0 * (1.0 - np.exp(-time_s / 500.0))
    columns = {"heater_W": np.full_like(time_s, 20.0), "n_rpm": np.full_like(time_s, 1000.0)}
    columns |= {"a_degC": warm + 3.0, "b_degC": warm, "c_degC": warm - 2.0}
    plant = build_plant(config)
    drive, estimator = Drive(config, plant), build_estimator(plant, config.estimator)
    _, inputs = drive.run(drive.initial(), frames(config, time_s, columns))
    return estimator.run(estimator.initial(), inputs)[1]


def rows_of(engine: str, **supports: Any) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Error and σ of a short run, and the field."""
    block = block_of(engine, **supports)
    return block.error_um, block.error_sigma_um, block.field_degC


@pytest.mark.parametrize("engine", ["compiled", "filterpy", "constant"])
def test_the_estimators_carry_the_sigma_through_linear_supports(engine: str) -> None:
    free, _, field = rows_of(engine)
    held, sigma, same = rows_of(engine, **LIII)
    np.testing.assert_array_equal(field, same)
    share = np.linspace(0.0, 1.0, free.shape[1])
    np.testing.assert_allclose(held, free - share * free[:, -1:], atol=1e-9)
    # rigid at both ends: known there without any doubt, doubtful in between
    np.testing.assert_allclose(sigma[1:, [0, -1]], 0.0, atol=1e-6)
    assert (sigma[1:, 10] > 1e-3).all()


@pytest.mark.parametrize("gap_m", [1e-3, 20e-6])
def test_what_a_gap_at_the_left_lets_go_leaves_there(gap_m: float) -> None:
    """As a screw that only the right support holds, as long as the gap is open."""
    free, free_sigma, _ = rows_of("compiled", mounting="L-II", first="right")
    error, sigma, _ = rows_of("compiled", **LIII, first="right", gap_m=gap_m)
    whole = -free[:, 0]
    near = 2.0 * free_sigma[:, 0]
    is_open = (whole > near) & (whole < 1e6 * gap_m - near)
    assert is_open.sum() > 20
    np.testing.assert_allclose(error[is_open], free[is_open], atol=1e-9)
    np.testing.assert_allclose(sigma[is_open], free_sigma[is_open], atol=1e-9)


@pytest.mark.parametrize("engine", ["compiled", "filterpy", "constant"])
def test_the_estimators_follow_a_gap_as_it_closes(engine: str) -> None:
    """Free while the gap is open, held by the same law afterwards, with the σ of each."""
    free, free_sigma, _ = rows_of(engine)
    held, held_sigma, _ = rows_of(engine, **LIII)
    gap_um = 20.0
    error, sigma, _ = rows_of(engine, **LIII, gap_m=gap_um * 1e-6)
    assert error.shape == free.shape
    whole = free[:, -1]
    near = 2.0 * free_sigma[:, -1]
    is_open, is_closed = (whole > near) & (whole < gap_um - near), whole > gap_um + near
    assert is_open.sum() > 20
    assert is_closed.sum() > 20
    np.testing.assert_allclose(error[is_open], free[is_open], atol=1e-9)
    np.testing.assert_allclose(sigma[is_open], free_sigma[is_open], atol=1e-9)
    share = np.linspace(0.0, 1.0, free.shape[1])
    np.testing.assert_allclose(error[is_closed], (held + share * gap_um)[is_closed], atol=1e-9)
    np.testing.assert_allclose(sigma[is_closed], held_sigma[is_closed], atol=1e-9)


@pytest.mark.parametrize("engine", ["compiled", "filterpy", "constant"])
def test_the_force_falls_as_a_pre_stretched_screw_warms(engine: str) -> None:
    """Less by the stiffness of screw and support in series for each micrometre that the free screw grows."""
    free, free_sigma, _ = rows_of(engine)
    own_N_um = 1e-6 / (0.4 / (MODULUS_PA * math.pi * 0.02**2 / 4) + 1 / 2e8)
    stretched = LIII | {"preload_N": 4000.0, "stiffness_second_N_m": 2e8}
    block = block_of(engine, **stretched)
    assert block.force_N.shape == block.force_sigma_N.shape == (len(free), 1)
    np.testing.assert_allclose(block.force_N, 4000.0 - own_N_um * free[:, -1:], rtol=1e-9)
    np.testing.assert_allclose(block.force_sigma_N, own_N_um * free_sigma[:, -1:], rtol=1e-9, atol=1e-9)
    assert block.force_N[0, 0] > 3500.0
    assert block.force_N[-1, 0] < 1000.0
    gapped = block_of(engine, **stretched | {"preload_N": 1000.0, "gap_m": 1e-3})
    slack_um, near_um = free[:, -1] - 1000.0 / own_N_um, 2.0 * free_sigma[:, -1]
    assert (slack_um > near_um).sum() > 20
    np.testing.assert_array_equal(gapped.force_N[slack_um > near_um], 0.0)
    np.testing.assert_array_equal(gapped.force_sigma_N[slack_um > near_um], 0.0)
    assert (gapped.force_sigma_N[np.abs(slack_um) < near_um] > 0.0).all()
    assert block_of(engine, mounting="L-II").force_N.shape == (len(free), 0)


def test_the_check_prints_force_and_where_pretension_and_gap_end() -> None:
    supports = LIII | {"preload_N": 4000.0, "gap_m": 10e-6, "stiffness_second_N_m": 2e8}
    found = findings(machine(supports=supports))["supports"]
    own = 0.4 / (MODULUS_PA * math.pi * 0.02**2 / 4)
    per_K = 11.8e-6 * 0.4
    lost_K = 4000.0 * (own + 1 / 2e8) / per_K
    assert found["pretension_lost_at_rise_K"] == pytest.approx(lost_K)
    assert found["gap_closed_at_rise_K"] == pytest.approx(lost_K + 10e-6 / per_K)
    assert found["force_at_10_K_N"] == pytest.approx(max(4000.0 * (1 - 10 / lost_K), 0.0))
    assert findings(machine())["supports"] is None


def test_a_simulation_writes_the_error_between_the_supports(tmp_path: Path) -> None:
    """With a gap too: the log has one error per grid point, zero at the support that is rigid and closed."""
    config = machine(supports=LIII | {"gap_m": 5e-6})
    time_s = np.arange(0.0, 2000.0, 5.0)
    write_log(tmp_path / "p.csv", time_s, {"heater_W": np.full(400, 25.0), "n_rpm": np.zeros(400)})
    run = observer.Machine(config, b"").simulate(tmp_path / "p.csv", start_degC=20.0)
    run.write(tmp_path, "log.csv")
    log = read_log(tmp_path / "log.csv")
    names = [c for c in log.channels if c.startswith("error_")]
    error = log.values[:, [log.channels.index(c) for c in names]]
    assert len(names) == 21
    assert error[0] == pytest.approx(0.0, abs=0.1)
    # once 5 µm have been grown the rigid second support lets the end no further
    assert error[-1, -1] == pytest.approx(5.0)
    assert error[-1].max() > 10.0


def test_near_a_bend_the_larger_sigma_is_reported() -> None:
    held = Restraint(np.array([0.0, 1.0]), lost_um=10.0, gap_um=20.0, stiffness_N_um=1.0)
    growth = np.array([[5.0], [10.5], [20.0], [29.0], [40.0]])
    value = np.hstack([np.zeros((5, 2)), np.tile([0.0, 1.0], (5, 1)) * growth, growth])
    sigma = np.tile([0.1, 0.2, 0.3, 0.1, 1.0], (5, 1))
    _, reported = fold(held, value, sigma)
    np.testing.assert_array_equal(reported[:, 0], [0.1, 0.3, 0.3, 0.3, 0.1])
    np.testing.assert_array_equal(reported[:, 1], [0.2, 0.2, 0.1, 0.2, 0.2])


@given(place=st.floats(-0.1, 0.5), slope=st.floats(-50.0, 50.0))
def test_the_error_at_the_nut_lies_on_the_line_between_grid_points(place: float, slope: float) -> None:
    assume(abs(slope) > 1e-3)
    grid = np.array([0.0, 0.1, 0.25, 0.4])
    error, sigma = error_at(np.array([place]), grid, slope * grid[None, :], 1.0 + grid[None, :])
    inside = min(max(place, 0.0), 0.4)
    assert error[0] == pytest.approx(slope * inside, abs=1e-9)
    assert sigma[0] == pytest.approx(1.0 + inside)


def test_a_nut_at_an_unknown_place_has_no_error() -> None:
    error, sigma = error_at(np.array([np.nan]), GRID, np.ones((1, 9)), np.ones((1, 9)))
    assert np.isnan([error[0], sigma[0]]).all()
