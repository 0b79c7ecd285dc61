"""The mounting, preload and gap under which the screw's thermal error is least.

The growth of the free screw is the same under all of them, so that one simulation serves every one: what
changes is only what the supports hold back (`supports`). Mountings are enumerated; preload and gap of a screw
that both supports hold are searched within bounds, beyond which nothing changes or force is only added.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np

from observer.config.mounting import Supports
from observer.config.screw import Screw
from observer.frames import BoolArray, FloatArray
from observer.model.rod.supports import (
    UM_PER_M,
    Restraint,
    displacement_um,
    force_N,
    restraint_of,
)

_MOST_STEPS = 600
"""Number of moments of a cycle in a search; all moments judge its result."""
_FORCE_um = 1e-3
"""Weight of the force against the error: of equal errors, the search prefers the smaller force."""
_BEYOND_um = 1e4
_EVALUATIONS = 1500


class MountedScrew(NamedTuple):
    """A mounting and its results over all moments.

    Attributes:
        supports: The supports.
        error_um: The largest thermal error by size in the travel, with its sign, µm.
        position_m: Its place, m.
        force_N: The largest axial force by size, N, tension positive.
    """

    supports: Supports
    error_um: float
    position_m: float
    force_N: float

    @property
    def size_um(self) -> float:
        """Magnitude of the error, µm."""
        return abs(self.error_um)


class MountingProblem(NamedTuple):
    """A screw and its growth, for which a mounting is searched.

    Attributes:
        screw: The screw.
        grid_m: Positions of the grid, (g,).
        travel: True for positions in the travel, (g,).
        along_um: Growth of the free screw up to each position, (K, g).
        whole_um: Growth of the whole free screw, (K,).
        permitted_N: The largest permitted force; None without a limit.
    """

    screw: Screw
    grid_m: FloatArray
    travel: BoolArray
    along_um: FloatArray
    whole_um: FloatArray
    permitted_N: float | None

    def restraint(self, supports: Supports) -> Restraint:
        """Return the restraint of supports on this screw."""
        return restraint_of(supports, self.screw, self.grid_m)


def best_of_each(problem: MountingProblem, configured: Supports | None) -> list[MountedScrew]:
    """Return the best of each mounting, the smallest error first.

    Preload and clearance of a screw held at both ends are searched: the preload up to where the growth no
    longer loses it, the clearance up to the growth. Mountings above the permitted force are left out.

    Args:
        problem: The screw and its growth.
        configured: Supports whose stiffness and modulus are taken. None takes rigid ones.
    """
    candidates = [_best(problem, supports) for supports in _mountings(configured)]
    allowed = [
        m for m in candidates if problem.permitted_N is None or abs(m.force_N) <= problem.permitted_N * 1.001
    ]
    return sorted(allowed, key=lambda m: m.size_um)


def _mountings(configured: Supports | None) -> Iterator[Supports]:
    """Yield every mounting without preload or clearance; sliding supports on either side are equivalent."""
    first, second = (
        (None, None)
        if configured is None
        else (configured.stiffness_first_N_m, configured.stiffness_second_N_m)
    )
    yield Supports(mounting="L-I")
    for mounting in ("L-II", "L-III", "L-IV"):
        for side in ("left", "right"):
            stiff = {"stiffness_first_N_m": first, "stiffness_second_N_m": second}
            if configured is not None:
                stiff["elastic_modulus_Pa"] = configured.elastic_modulus_Pa
            support_values = {
                key: value for key, value in stiff.items() if value is not None and mounting == "L-III"
            }
            if mounting != "L-III" or side == "left" or first != second:
                yield Supports.model_validate({"mounting": mounting, "first": side, **support_values})


def _best(problem: MountingProblem, supports: Supports) -> MountedScrew:
    """The best preload and clearance of a mounting."""
    if supports.mounting != "L-III":
        return judged(problem, supports)
    free = problem.restraint(supports)
    grown_um = float(problem.whole_um.max(initial=0.0))
    most_N = free.stiffness_N_um * grown_um
    if problem.permitted_N is not None:
        most_N = min(most_N, problem.permitted_N)
    if grown_um <= 0.0 or most_N <= 0.0:
        return judged(problem, supports)
    thinned = _thinned(problem)

    def cost_um(share: FloatArray) -> float:
        lost_um = share[0] * most_N / free.stiffness_N_um
        return _cost_um(thinned, free._replace(lost_um=lost_um, gap_um=share[1] * grown_um), most_N)

    share = _searched(cost_um)
    at = {"preload_N": round(share[0] * most_N, 3), "gap_m": round(share[1] * grown_um / UM_PER_M, 9)}
    return judged(problem, supports.model_copy(update=at))


def _searched(cost_um: Callable[[FloatArray], float]) -> FloatArray:
    """The least of a cost over the unit square: divided rectangles (Jones et al. 1993), then a simplex."""
    from scipy.optimize import Bounds, direct, minimize  # noqa: PLC0415  (start-up)

    bounds = Bounds([0.0, 0.0], [1.0, 1.0])
    coarse = direct(cost_um, bounds, maxfun=_EVALUATIONS, locally_biased=False)
    starts = [coarse.x, *np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [1.0, 1.0], [0.5, 0.0]])]
    best = min(starts, key=cost_um)
    finer = minimize(
        cost_um, best, method="Nelder-Mead", bounds=bounds,
        options={"xatol": 1e-6, "fatol": 1e-6, "maxfev": _EVALUATIONS},
    )  # fmt: skip
    return np.asarray(min((best, finer.x), key=cost_um))


def _cost_um(problem: MountingProblem, restraint: Restraint, scale_N: float) -> float:
    """The largest error in the travel, and a little for the force; much more beyond the largest allowed."""
    error_um = displacement_um(restraint, problem.along_um, problem.whole_um)
    peak_N = float(np.abs(force_N(restraint, problem.whole_um)).max())
    cost_um = float(np.abs(error_um[:, problem.travel]).max()) + _FORCE_um * peak_N / scale_N
    if problem.permitted_N is not None and peak_N > problem.permitted_N:
        cost_um += _BEYOND_um * (peak_N / problem.permitted_N - 1.0) + 1.0
    return cost_um


def judged(problem: MountingProblem, supports: Supports) -> MountedScrew:
    """Return a screw between given supports, over all moments.

    Args:
        problem: The screw and its growth.
        supports: The supports with preload and clearance.
    """
    restraint = problem.restraint(supports)
    error_um = displacement_um(restraint, problem.along_um, problem.whole_um)
    sizes = np.where(problem.travel, np.abs(error_um), -1.0)
    k, i = np.unravel_index(int(sizes.argmax()), sizes.shape)
    forces_N = force_N(restraint, problem.whole_um)
    force = float(forces_N[np.abs(forces_N).argmax()])
    return MountedScrew(supports, float(error_um[k, i]), float(problem.grid_m[i]), force)


def _thinned(problem: MountingProblem) -> MountingProblem:
    """The problem at few moments: evenly spread, and where any place is farthest."""
    count = len(problem.whole_um)
    evenly_spread = np.linspace(0, count - 1, min(count, _MOST_STEPS)).round().astype(int)
    columns = np.column_stack([problem.along_um, problem.whole_um])
    steps = np.unique(np.concatenate([evenly_spread, columns.argmax(axis=0), columns.argmin(axis=0)]))
    return problem._replace(along_um=problem.along_um[steps], whole_um=problem.whole_um[steps])
