"""How many modes are kept (Kim et al., eqs. 15–17), as printed and by the tail that is left."""

from __future__ import annotations

import numpy as np

from observer.frames import FloatArray
from observer.model.rod.modes import Modes
from observer.model.rod.static import Stretch, quadrature, source_field

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
    # the quadrature's own rounding stands in for the last digits of the tail
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
