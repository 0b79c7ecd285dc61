"""Additional modes of a screw whose moving nut exchanges much heat with a body.

Each place under the nut exchanges separately (Li 2022, eq. 45), so that the field bends under the stroke. The
slowest modes cannot follow a strong exchange. At rest, retained amplitudes a force the dropped ones to

    −(Λ_d + E_dd)⁻¹ E_dr a,

E the exchange in the modes and Λ_d the rates of the dropped ones. The largest singular vectors of this matrix
are the shapes that are missing. They are combinations of dropped modes, rotated so that a screw alone does
not couple them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from observer.effects.terms import Term
from observer.frames import FloatArray
from observer.model.network import attached, sweeping
from observer.model.reduce import FullModel
from observer.model.rod.modes import Modes, shapes_within
from observer.tables.sections import Description

LEAST_BENT = 0.02
"""Amplitude that a retained one forces on a missing shape, from which the plant gets a mode for it."""
MOST_CANDIDATES = 250


def with_bending(
    full: FullModel, mode_numbers: Sequence[int], machine: Description, terms: Sequence[Term]
) -> tuple[FullModel, list[int]]:
    """Return a full model with modes that bend under its nuts, and the numbers of its modes to keep.

    `mode_numbers` are the numbers (from 0) of the modes that are kept anyway. Without a strong exchange,
    both are returned unchanged.
    """
    modes, retained = full.modes, list(mode_numbers)
    candidates = list(range(min(len(modes), MOST_CANDIDATES)))
    dropped = [n for n in candidates if n not in retained]
    exchange_1_s = _exchange_1_s(modes.take(candidates), machine, terms)
    if exchange_1_s is None or not dropped:
        return full, retained
    stiff = np.diag(modes.decay_1_s[dropped]) + exchange_1_s[np.ix_(dropped, dropped)]
    driving = [n for n in retained if n < MOST_CANDIDATES]
    forced = np.linalg.solve(stiff, exchange_1_s[np.ix_(dropped, driving)])
    shapes, sizes, _ = np.linalg.svd(forced, full_matrices=False)
    shapes = shapes[:, : np.count_nonzero(sizes >= LEAST_BENT)]
    if not shapes.size:
        return full, retained
    decay_1_s, turn = np.linalg.eigh(shapes.T @ (modes.decay_1_s[dropped, None] * shapes))
    others = [n for n in range(len(modes)) if n not in retained]
    added = slice(len(retained), len(retained) + len(decay_1_s))
    combined = np.insert(
        np.eye(len(modes))[:, [*retained, *others]], [added.start] * len(decay_1_s), 0.0, axis=1
    )
    combined[dropped, added] = _pointed(shapes @ turn)
    rates_1_s = np.concatenate([modes.decay_1_s[retained], decay_1_s, modes.decay_1_s[others]])
    mix = combined if modes.mix is None else modes.mix @ combined
    known_inputs = tuple(k._replace(modal=k.modal @ combined) for k in full.known_inputs)
    bent = replace(full, modes=replace(modes, decay_1_s=rates_1_s, mix=mix), known_inputs=known_inputs)
    return bent, list(range(added.stop))


def _pointed(shapes: FloatArray) -> FloatArray:
    """The shapes (n, k) with the sign that makes the largest entry of each positive."""
    largest = shapes[np.argmax(np.abs(shapes), axis=0), np.arange(shapes.shape[1])]
    return np.asarray(shapes * np.sign(largest))


def _exchange_1_s(modes: Modes, machine: Description, terms: Sequence[Term]) -> FloatArray | None:
    """The exchange (N, N) of modes under nuts that sweep, with their bodies at 0 °C; None without one."""
    exchange = None
    for _, conductance_W_K, stroke in sweeping(machine, attached(machine, terms)):
        theta, weights = shapes_within(modes, stroke)
        per_K = conductance_W_K / (modes.rod.conductance_W_m * stroke.width_m)
        of_nut = (theta * (per_K * weights)[:, None]).T @ theta
        exchange = of_nut if exchange is None else exchange + of_nut
    return exchange
