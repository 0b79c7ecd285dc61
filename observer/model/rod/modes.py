"""Eigenmodes of the rod for every pairing of prescribed, insulated and convective ends.

One family covers all nine pairings: θ_n(x) = c_n cos(μ_n x − δ_n), where tan δ_n = H/μ_n with H = h_end/k
of the left end (δ = 0 insulated, π/2 prescribed). The right end asks μ L − δ_left(μ) − δ_right(μ) = n π, n
= 0, 1, …: a function that grows with μ and has exactly one root in [n π/L, (n + 1) π/L]. (Kim et al., eq. 6;
Carslaw & Jaeger 1959, §2.)
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from observer.frames import FloatArray
from observer.model.rod.screw import End, Rod
from observer.model.rod.static import Stretch, quadrature, source_field


@dataclass(frozen=True, slots=True)
class Modes:
    """The eigenmodes 1 … N of a rod, normalised so that ∫ θ_n θ_m dx / α = δ_nm (Kim et al., eq. 7).

    Shapes (N,): `mu_1_m` wave numbers, `phase` δ_n, `scale` c_n in √(m/s), `decay_1_s` Λ_n = α (μ_n² + m²).
    """

    rod: Rod
    mu_1_m: FloatArray
    phase: FloatArray
    scale: FloatArray
    decay_1_s: FloatArray

    def __len__(self) -> int:
        return len(self.mu_1_m)

    def take(self, index: FloatArray | list[int]) -> Modes:
        """Return only the modes at `index` (counted from 0)."""
        i = np.asarray(index, dtype=int)
        return Modes(self.rod, self.mu_1_m[i], self.phase[i], self.scale[i], self.decay_1_s[i])

    def theta(self, x_m: FloatArray | float) -> FloatArray:
        """θ_n at positions (k,) as (k, N)."""
        x = np.atleast_1d(np.asarray(x_m, dtype=float))[:, None]
        return np.asarray(self.scale * np.cos(self.mu_1_m * x - self.phase))

    def slope(self, x_m: float) -> FloatArray:
        """dθ_n/dx at one position, (N,)."""
        return np.asarray(-self.scale * self.mu_1_m * np.sin(self.mu_1_m * x_m - self.phase))

    def integral(self, a_m: FloatArray | float, b_m: FloatArray | float) -> FloatArray:
        """∫ θ_n dx from a to b, both (k,), as (k, N); exact, without cancellation for short stretches."""
        a = np.atleast_1d(np.asarray(a_m, dtype=float))[:, None]
        b = np.atleast_1d(np.asarray(b_m, dtype=float))[:, None]
        middle, half = (a + b) / 2, (b - a) / 2
        mean = np.cos(self.mu_1_m * middle - self.phase) * np.sinc(self.mu_1_m * half / np.pi)
        return np.asarray(2 * half * self.scale * mean)


def solve_modes(rod: Rod, count: int) -> Modes:
    """Return the first `count` modes of a rod, slowest first."""
    n = np.arange(count, dtype=float)
    mu = _wave_numbers(rod, n)
    phase = _end_phase(rod.left, mu)
    length, alpha = rod.length_m, rod.diffusivity_m2_s
    with np.errstate(invalid="ignore", divide="ignore"):
        ripple = (np.sin(2 * (mu * length - phase)) + np.sin(2 * phase)) / (4 * mu)
    norm2 = np.where(mu > 0, length / 2 + np.where(mu > 0, ripple, 0.0), length)
    return Modes(rod, mu, phase, np.sqrt(alpha / norm2), alpha * (mu**2 + rod.fin_1_m**2))


def held_s(decay_1_s: FloatArray, time_s: FloatArray | float) -> FloatArray:
    """Return what an input of 1 leaves of modes after it was held for a time: (1 − e^{−Λ t})/Λ, or t."""
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


def keep_by_ratio(modes: Modes, stretch: Stretch, beta: float) -> list[int]:
    """Kim's criterion as printed: modes (from 0) up to the first N with s_N/s_{N+1} ≥ β, nodes left out.

    It stops at the first small contribution, not at a small remainder: with a source near a node of a low
    mode it keeps too few. (Kim et al., eqs. 16–17.)
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


def tail_left(modes: Modes, kept: int, stretch: Stretch) -> float:
    """1 − s_N/s_∞: the part of a source's steady field that the first `kept` modes leave out."""
    s2 = np.sum(contributions(modes, stretch)[:kept] ** 2)
    return 1.0 - float(np.sqrt(min(s2 / _whole_square(modes, stretch), 1.0)))


def _whole_square(modes: Modes, stretch: Stretch) -> float:
    """s_∞² = ∫ Ψ²/α dx of a source's steady field in closed form."""
    x, w = quadrature(modes.rod.length_m, (stretch.a_m, stretch.b_m))
    return float(np.sum(w * source_field(modes.rod, stretch, x) ** 2) / modes.rod.diffusivity_m2_s)
