"""Eigenmodes of the rod for all pairs of prescribed, insulated and convective ends, and its steady fields.

One family covers all nine pairings: θ_n(x) = c_n cos(μ_n x − δ_n) with tan δ_n = H/μ_n. H = h_end/k is that
of the left end (δ = 0 insulated, π/2 prescribed). The right end requires

    μ L − δ_left(μ) − δ_right(μ) = n π,  n = 0, 1, …

The left side grows with μ and has exactly one root in [n π/L, (n + 1) π/L]. (Kim et al., eq. 6; Carslaw &
Jaeger 1959, §2.)

Steady fields are closed forms per unit of each input. With m = √(hP/kA), C(x) = cosh m x and S(x) =
sinh(m x)/m solve the homogeneous fin. Their combinations u_1 and u_2 meet the left and the right end.
Green's function is u_1(x_<) u_2(x_>)/(k A W). All tend to linear profiles of a bare rod as m → 0. (The same,
§4.5 and §14.)
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from observer.config.screw import Screw
from observer.config.sections import Source
from observer.frames import FloatArray
from observer.model.rod.screw import End, Rod
from observer.model.rod.stepped import (
    cosines_needed,
    galerkin_modes,
    stepped_end_field,
    stepped_source_field,
)

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
    if rod.profile is not None:
        return stepped_source_field(rod, stretch.a_m, stretch.b_m, x_m)
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
    if rod.profile is not None:
        return stepped_end_field(rod, side, x_m)
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
    breaks = np.clip([*np.linspace(0.0, length_m, panels + 1), *breaks_m], 0.0, length_m)
    edges = np.array(sorted(set(breaks.tolist())))  # np.unique would import numpy.ma: 5 MB, and 30 ms
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
    """The stretch over which a source deposits its heat, averaged over its motion.

    A nut's heat is uniform over its stroke (Kim et al., §5), or over the screw without a stroke. A source
    that heats nodes only has the left end as its place.
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
    stretches = [s for source in sources for s in design_stretches(source, screw)]
    return stretches or [Stretch(0.0, 0.0)]


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


@dataclass(frozen=True, slots=True)
class Modes:
    """The eigenmodes 1 … N of a rod, normalised so that ∫ θ_n θ_m dx / α = δ_nm (Kim et al., eq. 7).

    For a rod with sections, `mu_1_m`, `phase` and `scale` describe M cosines, from which `mix` makes the
    modes. Integrals ∫ … dx are then ∫ … a dx, a the cross-section as a multiple of the screw's.

    Attributes:
        rod: The rod.
        mu_1_m: Wave numbers, (N,) or (M,).
        phase: δ_n, likewise.
        scale: c_n, √(m/s), likewise.
        decay_1_s: Λ_n = α (μ_n² + m²), (N,).
        mix: The modes as combinations of cosines, (M, N); None for a uniform rod.
    """

    rod: Rod
    mu_1_m: FloatArray
    phase: FloatArray
    scale: FloatArray
    decay_1_s: FloatArray
    mix: FloatArray | None = None

    def __len__(self) -> int:
        return len(self.decay_1_s)

    def take(self, index: FloatArray | list[int]) -> Modes:
        """Return only the modes at `index` (counted from 0)."""
        i = np.asarray(index, dtype=int)
        if self.mix is not None:
            return replace(self, decay_1_s=self.decay_1_s[i], mix=self.mix[:, i])
        return Modes(self.rod, self.mu_1_m[i], self.phase[i], self.scale[i], self.decay_1_s[i])

    def theta(self, x_m: FloatArray | float) -> FloatArray:
        """θ_n at positions (k,) as (k, N)."""
        x = np.atleast_1d(np.asarray(x_m, dtype=float))[:, None]
        return self._mixed(np.asarray(self.scale * np.cos(self.mu_1_m * x - self.phase)))

    def _mixed(self, cosines: FloatArray) -> FloatArray:
        """The modes (…, N) from the cosines (…, M)."""
        return cosines if self.mix is None else cosines @ self.mix

    def slope(self, x_m: float) -> FloatArray:
        """dθ_n/dx at one position, (N,)."""
        return self._mixed(np.asarray(-self.scale * self.mu_1_m * np.sin(self.mu_1_m * x_m - self.phase)))

    def integral(self, a_m: FloatArray | float, b_m: FloatArray | float) -> FloatArray:
        """∫ θ_n dx from a to b, both (k,), as (k, N); exact, without cancellation for short stretches."""
        a = np.atleast_1d(np.asarray(a_m, dtype=float))[:, None]
        b = np.atleast_1d(np.asarray(b_m, dtype=float))[:, None]
        middle, half = (a + b) / 2, (b - a) / 2
        mean = np.cos(self.mu_1_m * middle - self.phase) * np.sinc(self.mu_1_m * half / np.pi)
        return self._mixed(np.asarray(2 * half * self.scale * mean))

    def stored(self) -> FloatArray:
        """∫ a θ_n dx over the rod, (N,): the modes' part in a uniform temperature."""
        profile = self.rod.profile
        if profile is None:
            return np.asarray(self.integral(0.0, self.rod.length_m)[0])
        edges = np.array(profile.edges_m)
        return np.asarray(np.array(profile.area) @ self.integral(edges[:-1], edges[1:]))

    def wetted(self, from_m: float, to_m: float) -> FloatArray:
        """∫ p θ_n dx over a stretch, (N,), p the perimeter as a multiple of the screw's."""
        profile = self.rod.profile
        if profile is None:
            return np.asarray(self.integral(from_m, to_m)[0])
        inside = np.clip(profile.edges_m, from_m, to_m)
        return np.asarray(np.array(profile.perimeter) @ self.integral(inside[:-1], inside[1:]))

    def surface(self) -> FloatArray:
        """∫ p θ_n θ_m dx/α, (N, N): the identity for a uniform rod, whose modes a film damps alike."""
        rod = self.rod
        nodes, weights = quadrature(rod.length_m, rod.edges_m, panels=max(24, len(self.mu_1_m) // 4))
        theta = self.theta(nodes)
        return np.asarray((theta.T * (weights * rod.perimeter_at(nodes))) @ theta / rod.diffusivity_m2_s)

    def settling(self, steady: Callable[[FloatArray], FloatArray]) -> FloatArray:
        """Return the input (N,) whose steady response is a field: Λ_n ∫ a θ_n T dx/α."""
        rod = self.rod
        nodes, weights = quadrature(rod.length_m, rod.edges_m, panels=max(24, len(self.mu_1_m) // 4))
        projection = (weights * rod.area_at(nodes) * steady(nodes)) @ self.theta(nodes)
        return np.asarray(self.decay_1_s * projection / rod.diffusivity_m2_s)


def solve_modes(rod: Rod, count: int) -> Modes:
    """Return the first `count` modes of a rod, slowest first."""
    if rod.profile is not None:
        return _stepped_modes(rod, count)
    n = np.arange(count, dtype=float)
    mu = _wave_numbers(rod, n)
    phase = _end_phase(rod.left, mu)
    length, alpha = rod.length_m, rod.diffusivity_m2_s
    with np.errstate(invalid="ignore", divide="ignore"):
        ripple = (np.sin(2 * (mu * length - phase)) + np.sin(2 * phase)) / (4 * mu)
    norm2 = np.where(mu > 0, length / 2 + np.where(mu > 0, ripple, 0.0), length)
    return Modes(rod, mu, phase, np.sqrt(alpha / norm2), alpha * (mu**2 + rod.fin_1_m**2))


@lru_cache(maxsize=16)
def _stepped_modes(rod: Rod, count: int) -> Modes:
    """The modes of a rod with sections; where only heats or sensors differ they are the same."""
    ends = (
        End(end.biot_1_m / area) for end, area in zip((rod.left, rod.right), _end_areas(rod), strict=True)
    )
    left, right = ends
    cosines = solve_modes(rod._replace(profile=None, left=left, right=right), cosines_needed(count))
    decay_1_s, mix = galerkin_modes(rod, cosines.mu_1_m, cosines.phase, cosines.scale, count)
    return replace(cosines, rod=rod, decay_1_s=decay_1_s, mix=mix)


def _end_areas(rod: Rod) -> tuple[float, float]:
    return (1.0, 1.0) if rod.profile is None else (rod.profile.area[0], rod.profile.area[-1])


def held_s(decay_1_s: FloatArray, time_s: FloatArray | float) -> FloatArray:
    """Return the response of modes to an input of 1 during a time: (1 − e^{−Λ t})/Λ, or t."""
    safe = np.where(decay_1_s > 0, decay_1_s, 1.0)
    return np.where(decay_1_s > 0, -np.expm1(-decay_1_s * time_s) / safe, time_s)


def _wave_numbers(rod: Rod, n: FloatArray) -> FloatArray:
    """μ_n: closed form where both ends are prescribed or insulated, else one bracketed root per interval."""
    plain = all(end.prescribed or end.insulated for end in (rod.left, rod.right))
    if plain:
        shift = 0.5 * (rod.left.prescribed + rod.right.prescribed)
        return np.asarray((n + shift) * np.pi / rod.length_m)
    from scipy.optimize.elementwise import find_root  # noqa: PLC0415  (start-up: only convective ends need it)

    def mismatch(mu: FloatArray, n: FloatArray) -> FloatArray:
        return mu * rod.length_m - _end_phase(rod.left, mu) - _end_phase(rod.right, mu) - n * np.pi

    tiny = 1e-12 / rod.length_m
    bracket = (np.maximum(n * np.pi / rod.length_m, tiny), (n + 1) * np.pi / rod.length_m)
    return np.asarray(find_root(mismatch, bracket, args=(n,), tolerances={"xrtol": 4e-16}).x)


def _end_phase(end: End, mu_1_m: FloatArray) -> FloatArray:
    """δ(μ) of one end, from 0 (insulated) to π/2 (prescribed)."""
    if end.prescribed:
        return np.full_like(mu_1_m, np.pi / 2)
    return np.arctan2(np.full_like(mu_1_m, end.biot_1_m), mu_1_m)


SMALL = 1e-9
"""Relative size below which a contribution counts as a node of the mode."""


def contributions(modes: Modes, stretch: Stretch) -> FloatArray:
    """Each mode's steady amplitude b_n/Λ_n per W of a source, (N,); 0 for a floating rod's drifting mean."""
    b = modal_input(modes, stretch)
    with np.errstate(divide="ignore"):
        return np.where(modes.decay_1_s > 0, b / np.where(modes.decay_1_s > 0, modes.decay_1_s, 1.0), 0.0)


def modal_input(modes: Modes, stretch: Stretch) -> FloatArray:
    """b_n = (1/kA) times the mean of θ_n over the stretch, (N,)."""
    kA = modes.rod.conductance_W_m
    if stretch.width_m == 0:
        return np.asarray(modes.theta(stretch.a_m)[0] / kA)
    return np.asarray(modes.integral(stretch.a_m, stretch.b_m)[0] / (kA * stretch.width_m))


def shapes_within(modes: Modes, stretch: Stretch) -> tuple[FloatArray, FloatArray]:
    """Return θ (k, N) and weights (k,) of the quadrature over a stretch."""
    nodes, weights = quadrature_within(modes.rod.length_m, stretch, modes.rod.edges_m)
    return modes.theta(nodes), weights


def wetted_within(modes: Modes, stretch: Stretch) -> tuple[FloatArray, FloatArray]:
    """The same with weights of the surface, as a multiple of the perimeter P."""
    nodes, weights = quadrature_within(modes.rod.length_m, stretch, modes.rod.edges_m)
    return modes.theta(nodes), weights * modes.rod.perimeter_at(nodes)


def keep_by_ratio(modes: Modes, stretch: Stretch, beta: float) -> list[int]:
    """Kim's criterion as printed: modes (from 0) up to the first N with s_N/s_{N+1} ≥ β, nodes left out.

    It stops at the first small contribution, not at a small remainder: with a source near a node of a low
    mode it keeps too few. (Kim et al., eqs. 16 and 17.)
    """
    c = contributions(modes, stretch)
    c = np.where(np.abs(c) > SMALL * np.max(np.abs(c)), c, 0.0)
    candidates = [i for i in range(len(c)) if c[i] != 0.0 or modes.decay_1_s[i] == 0.0]
    s2 = np.cumsum(c[candidates] ** 2)
    for n in range(1, len(candidates)):
        if s2[n - 1] > 0 and s2[n - 1] / s2[n] >= beta**2:
            return candidates[:n]
    return candidates


def keep_by_tail(modes: Modes, stretch: Stretch, beta: float) -> list[int]:
    """The smallest N with s_N/s_∞ ≥ β."""
    s2 = np.cumsum(contributions(modes, stretch) ** 2)
    # the quadrature rounds off the last digits of the tail
    enough = np.flatnonzero(s2 >= (beta**2 - 1e-13) * _whole_square(modes, stretch))
    return list(range(int(enough[0]) + 1 if len(enough) else len(modes)))


def tail_left(modes: Modes, count: int, stretch: Stretch) -> float:
    """1 − s_N/s_∞: the part of a source's steady field outside the first `count` modes."""
    s2 = np.sum(contributions(modes, stretch)[:count] ** 2)
    return 1.0 - float(np.sqrt(min(s2 / _whole_square(modes, stretch), 1.0)))


def _whole_square(modes: Modes, stretch: Stretch) -> float:
    """s_∞² = ∫ Ψ²/α dx of a source's steady field in closed form."""
    rod = modes.rod
    x, w = quadrature(rod.length_m, (stretch.a_m, stretch.b_m, *rod.edges_m))
    return float(np.sum(w * rod.area_at(x) * source_field(rod, stretch, x) ** 2) / rod.diffusivity_m2_s)
