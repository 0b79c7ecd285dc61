"""The best mounting, preload and gap against a search that tries them all by springs of its own."""

from __future__ import annotations

import math

import numpy as np
import pytest

from observer.config.mounting import Supports
from observer.config.screw import Screw
from observer.frames import FloatArray
from observer.model.rod.mountings import MountingProblem, best_of_each, judged

GRID_M = np.linspace(0.0, 1.0, 11)
AREA_m2, MODULUS_Pa = 1e-3, 2.06e11
SCREW = Screw(
    length_m=1.0, diameter_m=2.0 * math.sqrt(AREA_m2 / math.pi), conductivity_W_mK=50.0, density_kg_m3=7800.0,
    specific_heat_J_kgK=460.0,
)  # fmt: skip
FIRST_N_m, SECOND_N_m = 2e8, 1e8
GIVEN = Supports(mounting="L-III", stiffness_first_N_m=FIRST_N_m, stiffness_second_N_m=SECOND_N_m)


def problem(permitted_N: float | None, travel: tuple[float, float] = (0.0, 1.0)) -> MountingProblem:
    """A screw that warms, more so left of its middle."""
    warm_K = 4.0 + 16.0 * np.exp(-(((GRID_M - 0.35) / 0.2) ** 2))
    steps_um = 5.9 * (warm_K[1:] + warm_K[:-1]) * np.diff(GRID_M)
    along_um = np.multiply.outer(np.linspace(0.0, 1.0, 60) ** 0.5, np.append(0.0, np.cumsum(steps_um)))
    low_m, high_m = travel
    inside = (low_m <= GRID_M) & (high_m >= GRID_M)
    return MountingProblem(SCREW, GRID_M, inside, along_um, along_um[:, -1], permitted_N)


def by_springs(found: MountingProblem, preload_N: float, gap_m: float, *, right: bool) -> tuple[float, float]:
    """Largest error, µm, and force, N, of three springs in a row: the force at which they fit between their
    walls, moment by moment.
    """
    own = MODULUS_Pa * AREA_m2
    give_m_N = 1.0 / FIRST_N_m + 1.0 / SECOND_N_m + 1.0 / own
    worst_um, worst_N = 0.0, 0.0
    for along_um, whole_um in zip(found.along_um, found.whole_um, strict=True):
        tension_N = preload_N - whole_um * 1e-6 / give_m_N
        if tension_N < 0.0:  # the pull is lost; the screw crosses the gap, then pushes
            tension_N = min(0.0, preload_N - (whole_um * 1e-6 - gap_m) / give_m_N)
        # from the support that always holds: it gives way by what the force falls, and the screw in between
        from_m = 1.0 - found.grid_m if right else found.grid_m
        grown_um = whole_um - along_um if right else along_um
        away_um = grown_um + 1e6 * (tension_N - preload_N) * (1.0 / FIRST_N_m + from_m / own)
        moved_um = -away_um if right else away_um
        worst_um = max(worst_um, float(np.abs(moved_um[found.travel]).max()))
        worst_N = max(worst_N, abs(tension_N))
    return worst_um, worst_N


@pytest.mark.parametrize("permitted_N", [None, 5000.0, 1000.0])
def test_no_preload_and_gap_do_better_than_those_found(permitted_N: float | None) -> None:
    found = problem(permitted_N)
    for best in best_of_each(found, GIVEN):
        assert permitted_N is None or abs(best.force_N) <= 1.001 * permitted_N
        if best.supports.mounting != "L-III":
            continue
        right = best.supports.first == "right"
        held = by_springs(found, best.supports.preload_N, best.supports.gap_m, right=right)
        assert held == pytest.approx((best.size_um, abs(best.force_N)), rel=1e-6, abs=1e-3)
        tried = [
            by_springs(found, preload_N, gap_um * 1e-6, right=right)
            for preload_N in np.linspace(0.0, permitted_N or 8000.0, 17)
            for gap_um in np.linspace(0.0, float(found.whole_um.max()), 17)
        ]
        allowed_N = np.inf if permitted_N is None else permitted_N
        least_um = min(um for um, force_N in tried if force_N <= allowed_N)
        assert best.size_um <= least_um + 1e-2


def test_four_mountings_are_judged_and_the_smallest_error_is_first() -> None:
    found = best_of_each(problem(None), None)
    assert {one.supports.mounting for one in found} == {"L-I", "L-II", "L-III", "L-IV"}
    sizes = [one.size_um for one in found]
    assert sizes == sorted(sizes)


def test_only_the_travel_counts() -> None:
    whole, part = (judged(problem(None, travel), Supports(mounting="L-II")) for travel in ((0, 1), (0, 0.5)))
    assert whole.position_m == 1.0
    assert part.position_m == 0.5
    assert part.size_um < whole.size_um


def test_equal_errors_are_distinguished_by_their_force() -> None:
    """Without a gap the error does not depend on the preload; half of what the growth takes is best."""
    even: FloatArray = np.multiply.outer(np.array([0.0, 1.0]), 100.0 * GRID_M)
    found = best_of_each(problem(None)._replace(along_um=even, whole_um=even[:, -1]), None)[0]
    assert found.supports.mounting == "L-III"
    assert found.size_um == pytest.approx(0.0, abs=1e-6)
    assert abs(found.force_N) == pytest.approx(0.5 * 100e-6 * MODULUS_Pa * AREA_m2, rel=1e-3)
