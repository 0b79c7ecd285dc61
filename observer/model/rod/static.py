"""Where each source deposits its heat, and steady fields of the rod in closed form, per unit of each input.

For a film with m = √(hP/kA), C(x) = cosh m x and S(x) = sinh(m x)/m solve the homogeneous fin; u_1 and u_2
are the combinations that meet the left and the right end, and Green's function is u_1(x_<) u_2(x_>)/(k A
W). Everything tends to the linear profiles of a bare rod as m → 0. (Carslaw & Jaeger 1959, §4.5 and §14.)
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from observer.frames import FloatArray
from observer.model.rod.screw import End, Rod
from observer.tables.sections import Screw, Source

NODES = 16
"""Gauss points in a panel of the quadrature."""
_GAUSS_X, _GAUSS_W = np.polynomial.legendre.leggauss(NODES)


class Stretch(NamedTuple):
    """Where a source deposits its heat: uniform from a to b; a point where a = b."""

    a_m: float
    b_m: float

    @property
    def width_m(self) -> float:
        """Length of the stretch."""
        return self.b_m - self.a_m


def source_field(rod: Rod, stretch: Stretch, x_m: FloatArray) -> FloatArray:
    """Steady rise at positions (k,) in K per W of a source on a stretch.

    Where no heat can leave (`Rod.floating`) it is the zero-mean field that remains beside the drifting mean.
    """
    if rod.floating:
        return _floating_field(rod, stretch, x_m)
    L, a, b = rod.length_m, stretch.a_m, stretch.b_m
    left = _u(rod, rod.left, x_m)
    right = _u(rod, rod.right, L - x_m)
    # W = u_1' u_2 − u_1 u_2' is the same everywhere; at x = L, u_2 and its slope are known constants
    wronskian = _u_slope(rod, rod.left, L) * _u(rod, rod.right, 0.0)
    wronskian = wronskian + _u(rod, rod.left, L) * _u_slope(rod, rod.right, 0.0)
    below, above = np.minimum(x_m, b), np.maximum(x_m, a)
    if stretch.width_m == 0:
        value = np.where(x_m <= a, left * _u(rod, rod.right, L - a), right * _u(rod, rod.left, a))
    else:
        from_left = np.where(x_m > a, _u_integral(rod, rod.left, below) - _u_integral(rod, rod.left, a), 0.0)
        from_right = np.where(
            x_m < b, _u_integral(rod, rod.right, L - above) - _u_integral(rod, rod.right, L - b), 0.0
        )
        value = (right * from_left + left * from_right) / stretch.width_m
    return np.asarray(value / (rod.conductance_W_m * wronskian))


def end_field(rod: Rod, side: str, x_m: FloatArray) -> FloatArray:
    """Steady field (k,) in K per K of the prescribed end `side` ("left" or "right")."""
    L = rod.length_m
    if side == "left":
        return np.asarray(_u(rod, rod.right, L - x_m) / _u(rod, rod.right, L))
    return np.asarray(_u(rod, rod.left, x_m) / _u(rod, rod.left, L))


def ambient_field(rod: Rod, x_m: FloatArray) -> FloatArray:
    """Steady field (k,) in K per K of the ambient: what the prescribed ends leave of a uniform 1 K."""
    if rod.floating:
        return np.zeros_like(x_m)
    field = np.ones_like(x_m)
    for side, end in (("left", rod.left), ("right", rod.right)):
        if end.prescribed:
            field = field - end_field(rod, side, x_m)
    return field


def quadrature(length_m: float, breaks_m: Sequence[float], panels: int = 24) -> tuple[FloatArray, FloatArray]:
    """Nodes and weights (k,) from 0 to a length, `NODES` a panel, for functions with kinks at `breaks_m`."""
    within = np.clip([*np.linspace(0.0, length_m, panels + 1), *breaks_m], 0.0, length_m)
    edges = np.array(sorted(set(within.tolist())))  # np.unique would import numpy.ma: 5 MB, and 30 ms
    half = np.diff(edges)[:, None] / 2
    nodes = edges[:-1, None] + half * (1 + _GAUSS_X)
    return nodes.ravel(), (half * _GAUSS_W).ravel()


def quadrature_within(
    length_m: float, stretch: Stretch, breaks_m: Sequence[float] = ()
) -> tuple[FloatArray, FloatArray]:
    """Those nodes and weights of `quadrature` that lie on a stretch, at whose ends it breaks as well."""
    nodes, weights = quadrature(length_m, [stretch.a_m, stretch.b_m, *breaks_m])
    inside = (nodes > stretch.a_m) & (nodes < stretch.b_m)
    return nodes[inside], weights[inside]


def _C(rod: Rod, x: FloatArray | float) -> FloatArray:
    return np.cosh(rod.fin_1_m * np.asarray(x))


def _S(rod: Rod, x: FloatArray | float) -> FloatArray:
    m = rod.fin_1_m
    return np.sinh(m * np.asarray(x)) / m if m > 0 else np.asarray(x, dtype=float)


def _u(rod: Rod, end: End, x: FloatArray | float) -> FloatArray:
    """The homogeneous solution that meets an end at distance x = 0 from it."""
    return _S(rod, x) if end.prescribed else np.asarray(_C(rod, x) + end.biot_1_m * _S(rod, x))


def _u_slope(rod: Rod, end: End, x: float) -> FloatArray:
    m2S = rod.fin_1_m**2 * _S(rod, x)
    return _C(rod, x) if end.prescribed else np.asarray(m2S + end.biot_1_m * _C(rod, x))


def _u_integral(rod: Rod, end: End, x: FloatArray | float) -> FloatArray:
    """∫_0^x u; ∫ S is written with the half argument, so that nothing cancels for small m."""
    S_half = _S(rod, np.asarray(x) / 2)
    int_S = 2 * S_half**2
    return int_S if end.prescribed else np.asarray(_S(rod, x) + end.biot_1_m * int_S)


def _floating_field(rod: Rod, stretch: Stretch, x_m: FloatArray) -> FloatArray:
    """Zero-mean steady field of a source whose heat the whole rod stores evenly."""
    L, a, b = rod.length_m, stretch.a_m, stretch.b_m

    def ramp(x: FloatArray) -> FloatArray:
        return np.maximum(x, 0.0)

    if stretch.width_m == 0:
        deposited, mean = ramp(x_m - a), (L - a) ** 2 / (2 * L)
    else:
        deposited = (ramp(x_m - a) ** 2 - ramp(x_m - b) ** 2) / (2 * stretch.width_m)
        mean = ((L - a) ** 3 - (L - b) ** 3) / (6 * stretch.width_m * L)
    return np.asarray((x_m**2 / (2 * L) - L / 6 - deposited + mean) / rod.conductance_W_m)


def mean_stretch(source: Source, screw: Screw) -> Stretch:
    """The stretch over which a source deposits its heat, averaged over its motion; a source that heats nodes
    only stands nowhere, and has the left end for a place.

    A nut's heat is taken as uniform over its stroke (Kim et al., §5), or over the screw where the stroke is
    not given.
    """
    if source.shape in ("point", "node"):
        return Stretch(source.position_m or 0.0, source.position_m or 0.0)
    if source.shape == "band":
        return Stretch(source.from_m or 0.0, source.to_m or 0.0)
    low, high = source.stroke_m or (0.0, screw.length_m)
    return Stretch(low, high)


def nut_stretch(position_m: float, nut_length_m: float, screw_length_m: float) -> Stretch:
    """The stretch under a nut centred at a position, cut at the screw's ends (its heat is not cut)."""
    half = nut_length_m / 2
    centre = min(max(position_m, 0.0), screw_length_m)
    return Stretch(max(centre - half, 0.0), min(centre + half, screw_length_m))


def footprints(sources: Sequence[Source], screw: Screw) -> list[Stretch]:
    """All footprints that the number of modes must serve; the left end where no source is on the screw."""
    found = [s for source in sources for s in design_stretches(source, screw)]
    return found or [Stretch(0.0, 0.0)]


def design_stretches(source: Source, screw: Screw) -> list[Stretch]:
    """The footprints that the modes must serve: a moving nut at both ends and the middle of its stroke."""
    if source.shape == "node":
        return []
    mean = mean_stretch(source, screw)
    if source.shape != "nut" or source.position_channel is None:
        return [mean]
    nut_m = source.length_m or 0.0
    ends = (mean.a_m + nut_m / 2, mean.b_m - nut_m / 2) if source.stroke_m is None else (mean.a_m, mean.b_m)
    places = (ends[0], (mean.a_m + mean.b_m) / 2, ends[1])
    return [mean, *(nut_stretch(x, nut_m, screw.length_m) for x in places)]
