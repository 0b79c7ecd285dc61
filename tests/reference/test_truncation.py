"""How many modes are kept: Kim's numbers, his criterion's flaw, and what the default does about it."""

from __future__ import annotations

import mpmath as mp
import numpy as np
import pytest

from observer.model.build import build_plant, keep_modes
from observer.model.rod.modes import Modes, solve_modes
from observer.model.rod.screw import rod_of
from tests.reference.cases import config_of, point
from tests.truth.bar import Bar, End

PLAIN = Bar(convection_W_m2K=0.0)
HELD = (End("prescribed"), End("prescribed"))
SLOW = 1e9
"""A settling time that never asks for more modes, so that a criterion stands alone."""


def kept(place: float, criterion: str, bar: Bar = PLAIN, ends: tuple[End, End] = HELD) -> list[int]:
    model = {"criterion": criterion, "truncation": 0.9995, "settle_s": SLOW}
    config = config_of(bar, [point("heater", place)], [0.0, 1.0], ends=ends, model=model)
    return [i + 1 for i in keep_modes(config, solve_modes(rod_of(config), 401))]


@pytest.mark.parametrize(
    ("place", "modes"),
    [(0.1, [1, 2, 3, 4, 5, 6, 7]), (0.3, [1, 2, 3, 4, 5]), (0.5, [1, 3, 5]), (0.05, list(range(1, 13)))],
)
def test_kims_ratio_keeps_kims_modes(place: float, modes: list[int]) -> None:
    assert kept(place, "kim") == modes


def test_kims_ratio_stops_before_a_node_and_the_tail_does_not() -> None:
    # a_H = 0.35 L: mode 3 has a node nearby, so the ratio stops at two
    assert kept(0.35, "kim") == [1, 2]
    assert len(kept(0.35, "tail")) > 2


@pytest.mark.parametrize("ends", [HELD, (End(), HELD[0]), (End("convective", 40.0), End())])
@pytest.mark.parametrize("place", [0.03, 0.1, 0.25, 0.35, 0.5, 0.77])
def test_the_tail_left_is_below_what_beta_allows(ends: tuple[End, End], place: float) -> None:
    """s_N/s_∞ ≥ β, counted here with a thousand modes instead of the closed form."""
    bar = Bar(convection_W_m2K=10.0)
    config = config_of(bar, [point("heater", place)], [0.0, 1.0], ends=ends)
    modes = solve_modes(rod_of(config), 1000)
    s2 = np.cumsum((modes.theta(place)[0] / modes.decay_1_s) ** 2)
    number = len(kept(place, "tail", bar, ends))
    # the 1001st mode on adds 1e-9 of the sum: below what separates two neighbours
    assert np.sqrt(s2[number - 1] / s2[-1]) >= 0.9995 - 1e-8
    assert number == 1 or np.sqrt(s2[number - 2] / s2[-1]) < 0.9995


def test_enough_modes_are_kept_for_the_dropped_ones_to_settle() -> None:
    config = config_of(PLAIN, [point("heater", 0.1)], [0.0, 1.0], ends=HELD, model={"settle_s": 10.0})
    plant = build_plant(config)
    alpha = PLAIN.diffusivity_m2_s
    assert plant.modes == len(plant.mode_index)
    assert alpha * ((plant.modes + 1) * np.pi) ** 2 >= 0.1 > alpha * (plant.modes * np.pi) ** 2


@pytest.mark.parametrize("film_W_m2K", [0.0, 25.0])
@pytest.mark.parametrize("right", [End(), End("prescribed"), End("convective", 800.0)])
@pytest.mark.parametrize("left", [End(), End("prescribed"), End("convective", 3.0)])
def test_the_modes_meet_their_ends_and_each_other(left: End, right: End, film_W_m2K: float) -> None:
    bar = Bar(convection_W_m2K=film_W_m2K)
    config = config_of(bar, [point("heater", 0.4)], [0.0, 1.0], ends=(left, right))
    modes = solve_modes(rod_of(config), 30)
    _meets(modes, left, 0.0, -1.0)
    _meets(modes, right, 1.0, 1.0)
    # 400 Gauss points carry products of 30 waves to rounding
    node, weight = np.polynomial.legendre.leggauss(400)
    theta = modes.theta(0.5 + 0.5 * node)
    gram = (theta * (0.5 * weight)[:, None]).T @ theta / bar.diffusivity_m2_s
    np.testing.assert_allclose(gram, np.eye(30), atol=1e-11)
    film_1_s = bar.film_W_mK / bar.capacity_J_mK
    np.testing.assert_allclose(modes.decay_1_s, bar.diffusivity_m2_s * modes.mu_1_m**2 + film_1_s, rtol=1e-13)


def _meets(modes: Modes, end: End, x_m: float, outward: float) -> None:
    value, slope = modes.theta(x_m)[0], modes.slope(x_m)
    if end.kind == "prescribed":
        np.testing.assert_allclose(value, 0.0, atol=1e-13)
    else:
        flux = outward * PLAIN.conductivity_W_mK * slope + end.coefficient_W_m2K * value
        # rounding of μ (1e-16 relative) times k μ² θ
        np.testing.assert_allclose(flux, 0.0, atol=1e-10)


def test_no_root_of_a_convective_pair_is_missed() -> None:
    """Against the textbook equation tan μ = μ (H_1 + H_2)/(μ² − H_1 H_2), solved in 30 digits."""
    config = config_of(
        PLAIN, [point("heater", 0.4)], [0.0, 1.0], ends=(End("convective", 20.0), End("convective", 900.0))
    )
    one, two = mp.mpf(20) / 50, mp.mpf(900) / 50
    for number, mu in enumerate(solve_modes(rod_of(config), 25).mu_1_m):
        with mp.workdps(30):

            def gap(m: mp.mpf) -> mp.mpf:
                return (m**2 - one * two) * mp.sin(m) - m * (one + two) * mp.cos(m)

            root = mp.findroot(gap, mp.mpf(mu))
        assert mu == pytest.approx(float(root), rel=1e-14)
        assert number * np.pi < mu < (number + 1) * np.pi
