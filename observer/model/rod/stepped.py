"""A rod whose cross-section and perimeter differ from section to section: its modes and its steady fields.

Modes are combinations of the cosines φ of the uniform rod: K v = (Λ/α) M v (Galerkin; Fletcher 1984, §1.3).
K_ij = ∫ a φ_i' φ_j' + m² p φ_i φ_j dx plus the ends' films, and M_ij = ∫ a φ_i φ_j dx. Here a and p are the
multiples of k A and h P. All integrals are exact: products of cosines over stretches.

Steady fields are exact: u = cosh and sinh of each section, with temperature and heat flow continuous at the
edges (Carslaw & Jaeger 1959, §4.5). Green's function is that of the uniform rod.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from observer.frames import FloatArray
from observer.model.rod.screw import End, Profile, Rod


def cosines_needed(count: int) -> int:
    """Return the number of cosines for `count` modes; further cosines only round the kinks at the edges."""
    return max(160, min(4 * count, count + 100))


def galerkin_modes(
    rod: Rod, mu_1_m: FloatArray, phase: FloatArray, scale: FloatArray, count: int
) -> tuple[FloatArray, FloatArray]:
    """Return the first modes of a stepped rod.

    Args:
        rod: A rod with a profile.
        mu_1_m: Wave numbers of M cosines scale · cos(μ x − phase) that meet its ends, 1/m, (M,).
        phase: Their phases, (M,).
        scale: Their amplitudes, (M,).
        count: Number N of modes, at most M.

    Returns:
        Decay rates, 1/s, (N,), ascending, and shapes as combinations of the cosines, (M, N). Shapes are
        normalised to ∫ a v² dx = α, as are those of a uniform rod.

    Raises:
        ValueError: If the rod is uniform.
    """
    from scipy.linalg import eigh  # noqa: PLC0415  (start-up: a uniform screw needs none)

    profile, n = _profile(rod), len(mu_1_m)
    apart, total = mu_1_m[:, None] - mu_1_m, mu_1_m[:, None] + mu_1_m
    turned, both = phase[:, None] - phase, phase[:, None] + phase
    size, steep = 0.5 * np.multiply.outer(scale, scale), np.multiply.outer(mu_1_m, mu_1_m)
    mass, stiff = np.zeros((n, n)), np.zeros((n, n))
    for i, (a, p) in enumerate(zip(profile.area, profile.perimeter, strict=True)):
        ends_m = profile.edges_m[i], profile.edges_m[i + 1]
        of_difference, of_sum = _cosine(apart, turned, *ends_m), _cosine(total, both, *ends_m)
        stored = size * (of_difference + of_sum)
        mass += a * stored
        stiff += a * size * steep * (of_difference - of_sum) + rod.fin_1_m**2 * p * stored
    for end, x_m in ((rod.left, 0.0), (rod.right, rod.length_m)):
        if not end.prescribed:
            at = scale * np.cos(mu_1_m * x_m - phase)
            stiff += end.biot_1_m * np.multiply.outer(at, at)
    rates, shapes = eigh(stiff, mass, subset_by_index=(0, count - 1))
    shapes = shapes * np.sign(shapes[np.argmax(np.abs(shapes), axis=0), np.arange(count)])
    if rod.floating:
        rates[0] = 0.0  # of the mean, which drifts; rounding leaves something
    alpha = rod.diffusivity_m2_s
    return alpha * np.maximum(rates, 0.0), np.sqrt(alpha) * shapes


def _cosine(wave_1_m: FloatArray, phase: FloatArray, a_m: float, b_m: float) -> FloatArray:
    """∫ cos(κ x − ψ) dx from a to b, without cancellation for small κ."""
    half = (b_m - a_m) / 2
    middle = np.cos(wave_1_m * ((a_m + b_m) / 2) - phase)
    return np.asarray(2 * half * middle * np.sinc(wave_1_m * half / np.pi))


def _profile(rod: Rod) -> Profile:
    if rod.profile is None:
        raise ValueError("a uniform rod has no profile")
    return rod.profile


class _Fin(NamedTuple):
    """The solution of a fin without sources that meets the left end.

    Attributes:
        edges_m: Edges of the sections, (S + 1,).
        fin_1_m: m of each section, (S,).
        area: The multiple of k A of each section, (S,).
        u: u at the left edge of each section, (S,).
        flow: The flow a u' there, (S,).
        gathered: ∫_0 u up to there, (S,).
    """

    edges_m: FloatArray
    fin_1_m: FloatArray
    area: FloatArray
    u: FloatArray
    flow: FloatArray
    gathered: FloatArray

    def _in(self, x_m: FloatArray | float) -> tuple[Any, FloatArray, FloatArray]:
        """The sections of places, m there, and the distances from the sections' left edges."""
        x = np.asarray(x_m, dtype=float)
        i = np.searchsorted(self.edges_m[1:-1], x, side="right")
        return i, self.fin_1_m[i], x - self.edges_m[i]

    def value(self, x_m: FloatArray | float) -> FloatArray:
        """u at places (k,)."""
        i, m, s = self._in(x_m)
        return np.asarray(self.u[i] * np.cosh(m * s) + self.flow[i] / self.area[i] * _S(m, s))

    def slope(self, x_m: FloatArray | float) -> FloatArray:
        """The flow a u' at places (k,)."""
        i, m, s = self._in(x_m)
        return np.asarray(self.flow[i] * np.cosh(m * s) + self.area[i] * m**2 * _S(m, s) * self.u[i])

    def integral(self, x_m: FloatArray | float) -> FloatArray:
        """∫_0^x u at places (k,)."""
        i, m, s = self._in(x_m)
        of_S = 2 * _S(m, s / 2) ** 2
        return np.asarray(self.gathered[i] + self.u[i] * _S(m, s) + self.flow[i] / self.area[i] * of_S)


def _S(m: FloatArray, s: FloatArray) -> FloatArray:
    """sinh(m s)/m, s where m = 0."""
    safe = np.where(m > 0, m, 1.0)
    return np.where(m > 0, np.sinh(safe * s) / safe, s)


def _fin(profile: Profile, fin_1_m: float, end: End) -> _Fin:
    edges, area = np.array(profile.edges_m), np.array(profile.area)
    m = fin_1_m * np.sqrt(np.array(profile.perimeter) / area)
    u, flow, gathered = (0.0, 1.0, 0.0) if end.prescribed else (1.0, end.biot_1_m, 0.0)
    rows = []
    for width, a, section_m in zip(np.diff(edges), area, m, strict=True):
        rows.append((u, flow, gathered))
        C, S, of_S = np.cosh(section_m * width), _S(section_m, width), 2 * _S(section_m, width / 2) ** 2
        gathered += u * S + flow / a * of_S
        u, flow = u * C + flow / a * S, flow * C + a * section_m**2 * S * u
    return _Fin(edges, m, area, *np.array(rows).T)


class _Ends(NamedTuple):
    """The solutions that meet the left end and, seen from it, the right end, and their Wronskian."""

    left: _Fin
    right: _Fin
    wronskian: float


@lru_cache(maxsize=8)
def _end_solutions(rod: Rod) -> _Ends:
    profile, L = _profile(rod), rod.length_m
    turned = Profile(
        tuple(L - x for x in reversed(profile.edges_m)), profile.area[::-1], profile.perimeter[::-1]
    )
    left, right = _fin(profile, rod.fin_1_m, rod.left), _fin(turned, rod.fin_1_m, rod.right)
    wronskian = left.slope(L) * right.value(0.0) + left.value(L) * right.slope(0.0)
    return _Ends(left, right, float(wronskian))


def stepped_source_field(rod: Rod, a_m: float, b_m: float, x_m: FloatArray) -> FloatArray:
    """Return the steady rise at places per watt of a source, K/W, (k,), as `modes.source_field`.

    Without any loss it is the rise relative to the drifting mean.

    Args:
        rod: A rod with a profile.
        a_m: Beginning of the source, m.
        b_m: Its end, m; equal to `a_m` for a point.
        x_m: Places, m, (k,).
    """
    if rod.floating:
        return _floating_field(rod, a_m, b_m, x_m)
    (left, right, wronskian), L, x = _end_solutions(rod), rod.length_m, np.asarray(x_m, dtype=float)
    if a_m == b_m:
        low, high = np.minimum(x, a_m), np.maximum(x, a_m)
        value = left.value(low) * right.value(L - high)
    else:
        inside = np.clip(x, a_m, b_m)
        from_left = left.integral(inside) - left.integral(a_m)
        from_right = right.integral(L - inside) - right.integral(L - b_m)
        value = (right.value(L - x) * from_left + left.value(x) * from_right) / (b_m - a_m)
    return np.asarray(value / (rod.conductance_W_m * wronskian))


def stepped_end_field(rod: Rod, side: str, x_m: FloatArray) -> FloatArray:
    """Return the steady field per kelvin of a prescribed end, K/K, (k,).

    Args:
        rod: A rod with a profile.
        side: `"left"`, else the right end is taken.
        x_m: Places, m, (k,).
    """
    (left, right, _), L = _end_solutions(rod), rod.length_m
    if side == "left":
        return np.asarray(right.value(L - np.asarray(x_m)) / right.value(L))
    return np.asarray(left.value(x_m) / left.value(L))


def _floating_field(rod: Rod, a_m: float, b_m: float, x_m: FloatArray) -> FloatArray:
    """The field of a source whose heat the whole rod stores evenly, relative to the drifting mean.

    Its heat flow is linear between edges, so the field is a parabola there.
    """
    profile = _profile(rod)
    knots = np.array(sorted({*profile.edges_m, a_m, b_m}))
    middle, width = (knots[1:] + knots[:-1]) / 2, np.diff(knots)
    a = profile.at(profile.area, middle)
    stored = np.concatenate([[0.0], np.cumsum(a * width)]) / rod.storage_m
    deposited = np.clip((knots - a_m) / (b_m - a_m), 0.0, 1.0) if b_m > a_m else None
    if deposited is None:  # a point: what has passed it, seen from either side
        before, after = (knots > a_m).astype(float), (knots >= a_m).astype(float)
    else:
        before = after = deposited
    first, last = (stored[:-1] - after[:-1]) / a, (stored[1:] - before[1:]) / a
    rise = np.concatenate([[0.0], np.cumsum(0.5 * (first + last) * width)])

    def field(x: FloatArray) -> FloatArray:
        i = np.clip(np.searchsorted(knots, x, side="right") - 1, 0, len(width) - 1)
        s = x - knots[i]
        return np.asarray(rise[i] + first[i] * s + (last - first)[i] / width[i] * s**2 / 2)

    simpson = (rise[:-1] + 4 * field(middle) + rise[1:]) / 6  # exact for a parabola
    mean = (a * width) @ simpson / rod.storage_m
    return np.asarray((field(np.asarray(x_m, dtype=float)) - mean) / rod.conductance_W_m)
