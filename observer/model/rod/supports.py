"""The screw between its axial supports: displacement, restrained growth, and the axial force.

N is the axial force (tension positive), P the pre-tension at the reference temperature. D = ∫_0^L β θ dx is
the growth of the free screw, and 1/j_Σ = 1/j_1 + 1/j_2 + L/EF. Displacements are counted from the assembled,
pre-stretched state:

    U(x) = ∫_0^x β θ dx + (N − P) (1/j_1 + x/EF),      N = P − j_Σ H(D).

The restrained growth H is D if the supports hold in both directions. With a clearance δ_0 the second support
only pulls until the pre-tension is lost, at D_1 = P/j_Σ. It lets the screw grow freely across the clearance,
and then pushes: H = min(D, D_1) + max(D − D_1 − δ_0, 0). If the first support is at the right, the
unrestrained growth D − H leaves at the left and is subtracted from U(x).

Source: Kuznetsov 2021, eqs. 12 and 13. Without pre-tension and clearance this is (12), with a closed
clearance (13). Two terms of (13) as printed are corrected here. Its bracket holds x·P/EF where the whole
screw must count. It also subtracts the pre-tension's stretch x·P/EF, although the machine is set up with it.
For a screw with sections x/EF is ∫_0^x dx/EF.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from observer.config.mounting import Supports
from observer.config.screw import Screw
from observer.frames import FloatArray

UM_PER_M = 1e6
_NEAR_SIGMAS = 2.0


class Restraint(NamedTuple):
    """Supports on the grid: U = free growth − `hold` · H(D), in µm.

    With `leaves_left`, D − H(D) is subtracted too: the screw moves through a clearance at the left.

    Attributes:
        hold: j_Σ (1/j_1 + x/EF): 0 where the screw is fixed, 1 where all its growth is pushed back, (g,).
        lost_um: The growth D_1 at which the pre-tension is lost.
        gap_um: The clearance.
        stiffness_N_um: j_Σ.
        leaves_left: Whether the unrestrained growth leaves at the left.
    """

    hold: FloatArray
    lost_um: float
    gap_um: float
    stiffness_N_um: float
    leaves_left: bool = False

    @property
    def linear(self) -> bool:
        """Whether displacement is linear in temperature: no clearance."""
        return self.gap_um == 0.0

    @property
    def holds(self) -> bool:
        """Whether the screw is held at both ends, so that there is an axial force in it."""
        return self.stiffness_N_um > 0.0


def restraint_of(supports: Supports, screw: Screw, grid_m: FloatArray) -> Restraint:
    """Return the restraint of supports at positions of a screw.

    If only one support holds, the screw grows away from it. If both slide, it grows from its middle.

    Args:
        supports: The table `[supports]`.
        screw: The screw, whose stiffness counts between two holding supports.
        grid_m: Positions on the screw, m, (g,).
    """
    screw_m_N = screw.length_m / (supports.elastic_modulus_Pa * screw.spring_area_m2)
    left, right = _compliances_m_N(supports)
    share = screw.spring_share(grid_m)
    if math.isinf(left) and math.isinf(right):
        return Restraint(np.full_like(grid_m, 0.5), 0.0, 0.0, 0.0)
    if math.isinf(left) or math.isinf(right):
        return Restraint(np.full_like(grid_m, 1.0 if math.isinf(left) else 0.0), 0.0, 0.0, 0.0)
    total = left + screw_m_N + right
    return Restraint(
        hold=(left + screw_m_N * share) / total,
        lost_um=supports.preload_N * total * UM_PER_M,
        gap_um=supports.gap_m * UM_PER_M,
        stiffness_N_um=1.0 / total / UM_PER_M,
        leaves_left=supports.first == "right",
    )


def _compliances_m_N(supports: Supports) -> tuple[float, float]:
    """1/j of the left and the right support; infinite where it lets the screw slide."""
    first = math.inf if supports.mounting == "L-I" else _inverse(supports.stiffness_first_N_m)
    second = _inverse(supports.stiffness_second_N_m) if supports.mounting == "L-III" else math.inf
    return (first, second) if supports.first == "left" else (second, first)


def _inverse(stiffness_N_m: float | None) -> float:
    return 0.0 if stiffness_N_m is None else 1.0 / stiffness_N_m


def held_back_um(restraint: Restraint, growth_um: FloatArray) -> FloatArray:
    """Return H(D), the restrained part of the free screw's growth, µm.

    Args:
        restraint: The supports.
        growth_um: Growth D of the whole free screw, µm, any shape.
    """
    pulled = np.minimum(growth_um, restraint.lost_um)
    return np.asarray(pulled + np.maximum(growth_um - restraint.lost_um - restraint.gap_um, 0.0))


def taken_off_um(restraint: Restraint, growth_um: FloatArray) -> FloatArray:
    """Return the reduction of the free growth at each place, µm, (…, g).

    Args:
        restraint: The supports.
        growth_um: Growth of the whole free screw, µm, (…, 1).
    """
    held_um = held_back_um(restraint, growth_um)
    return np.asarray(restraint.hold * held_um + restraint.leaves_left * (growth_um - held_um))


def force_N(restraint: Restraint, growth_um: FloatArray) -> FloatArray:
    """Return the axial force in the screw, N, tension positive: N = j_Σ (D_1 − H(D)).

    The bearings of the supports carry it in addition to the load of the drive.

    Args:
        restraint: The supports.
        growth_um: Growth of the whole free screw, µm, any shape.
    """
    return np.asarray(restraint.stiffness_N_um * (restraint.lost_um - held_back_um(restraint, growth_um)))


def displacement_um(restraint: Restraint | None, growth_um: FloatArray, whole_um: FloatArray) -> FloatArray:
    """Return the displacement U at each place, µm, (K, g).

    Args:
        restraint: The supports; None leaves the free growth.
        growth_um: Growth of the free screw up to each place, µm, (K, g).
        whole_um: Growth of the whole free screw, µm, (K,).
    """
    if restraint is None:
        return growth_um
    return np.asarray(growth_um - taken_off_um(restraint, whole_um[..., None]))


def restrained_rows(restraint: Restraint | None, free: FloatArray) -> FloatArray:
    """Return the rows of the thermal error from those of the free growth.

    `fold` makes the error from all of these, and `tension` the force.

    Args:
        restraint: The supports; None leaves the free growth.
        free: Growth from x = 0 to each grid point, then to the screw's end, (g + 1, …).

    Returns:
        g rows that are linear in the temperature. With a clearance, these are followed by g rows for a screw
        without the second support. If both ends are held, the last row is the growth of the whole free screw.
    """
    growth, whole = free[:-1], free[-1:]
    if restraint is None:
        return growth
    held_rows = growth - np.multiply.outer(restraint.hold, free[-1])
    if not restraint.linear:
        return np.concatenate([held_rows, growth - restraint.leaves_left * whole, whole])
    return np.concatenate([held_rows, whole]) if restraint.holds else held_rows


def fold(restraint: Restraint | None, value: FloatArray, sigma: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return error and σ, µm, (K, g), from the values of `restrained_rows` and their σ.

    H is linearised at the estimate. The σ is that of the held rows where H follows the growth, and that of
    the free rows where H is constant. Within two σ of a bend, it is the larger of both.

    Args:
        restraint: The supports; None returns the arguments.
        value: Values of the rows, µm, (K, g), (K, g + 1) or (K, 2 g + 1).
        sigma: Their σ, µm, of the same shape.
    """
    if restraint is None or value.shape[1] == 0:
        return value, sigma
    g = len(restraint.hold)
    if restraint.linear:
        return value[:, :g], sigma[:, :g]
    growth = value[:, -1:]
    error = value[:, :g] + restraint.hold * growth - taken_off_um(restraint, growth)
    held_sigma, free_sigma = sigma[:, :g], sigma[:, g : 2 * g]
    inside, outside = _about_gap(restraint, growth, sigma[:, -1:])
    return error, np.where(
        inside, free_sigma, np.where(outside, held_sigma, np.maximum(held_sigma, free_sigma))
    )


def tension(
    restraint: Restraint | None, value: FloatArray, sigma: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the axial force, N, tension positive, and its σ, (K, 1).

    Within a clearance the force is 0. Within two σ of its ends the σ is that of a held screw.

    Args:
        restraint: The supports.
        value: Values of the rows as in `fold`, µm.
        sigma: Their σ, µm.

    Returns:
        Force and σ; both (K, 0) without a support at each end.
    """
    if restraint is None or not restraint.holds or value.shape[1] == 0:
        no_force = np.zeros((len(value), 0))
        return no_force, no_force
    growth, growth_sigma = value[:, -1:], sigma[:, -1:]
    inside, _ = _about_gap(restraint, growth, growth_sigma)
    return force_N(restraint, growth), np.where(inside, 0.0, restraint.stiffness_N_um * growth_sigma)


def _about_gap(restraint: Restraint, growth: FloatArray, sigma: FloatArray) -> tuple[Any, Any]:
    """Where the screw is surely within the clearance, and where it is surely outside."""
    near = _NEAR_SIGMAS * sigma
    first, last = restraint.lost_um, restraint.lost_um + restraint.gap_um
    return (
        (growth > first + near) & (growth < last - near),
        (growth < first - near) | (growth > last + near),
    )


def error_at(
    position_m: FloatArray, grid_m: FloatArray, error_um: FloatArray, sigma_um: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the thermal error at a position of each step, as of the nut, and its σ, µm, (K,).

    Linear between grid points; the σ between two points is at most the interpolated one.

    Args:
        position_m: The position in each step, m, (K,). Beyond the grid it gets the value at its end; NaN
            gives NaN.
        grid_m: Grid points, m, (g,), two or more.
        error_um: Thermal error, µm, (K, g).
        sigma_um: Its σ, µm, (K, g).
    """
    place = np.interp(position_m, grid_m, np.arange(len(grid_m), dtype=float))
    is_known = np.isfinite(place)
    low = np.minimum(np.where(is_known, place, 0.0).astype(int), len(grid_m) - 2)
    right, row = np.where(is_known, place - low, np.nan), np.arange(len(place))
    values = [(1.0 - right) * a[row, low] + right * a[row, low + 1] for a in (error_um, sigma_um)]
    return values[0], values[1]
