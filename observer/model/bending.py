"""Additional modes of a screw whose nuts exchange heat with nodes, which bend under their strokes.

Each place under a nut exchanges separately (Li 2022, eq. 45), so that the field bends under the stroke. The
slowest modes cannot follow a strong exchange. At rest, retained amplitudes a force the dropped ones to

    −(Λ_d + E_dd)⁻¹ E_dr a,

E the exchange in the modes and Λ_d the rates of the dropped ones. The largest singular vectors of this matrix
are the shapes that are missing. They are combinations of dropped modes, rotated so that a screw alone does
not couple them. Their number is fixed: one more or less would be a step in the misfit of a search.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from observer.frames import FloatArray
from observer.model.network import Exchange
from observer.model.reduce import FullModel
from observer.model.rod.modes import Modes, shapes_within

BENT_MODES = 6
"""Number of additional modes for each nut."""
FAINT = 1e-6
"""Amplitude from which an exchange determines the shapes."""
CANDIDATES = 160
"""Number of modes of the full model that are combined; more would only round the kinks at a stroke's ends."""


def with_bending(full: FullModel, mode_numbers: Sequence[int]) -> tuple[FullModel, list[int], int]:
    """Return a full model with modes that bend under its nuts, the numbers of its modes to keep, and how many
    of these bend.

    `mode_numbers` are the numbers (from 0) of the modes that are kept anyway; they come first in the new
    model, and those that bend behind them. Without an exchange, none bend.
    """
    retained, most = list(mode_numbers), min(len(full.modes), CANDIDATES)
    dropped = sorted(set(range(most)) - set(retained))
    number = min(BENT_MODES * len(full.steady.exchanges), len(retained), len(dropped) - 1)
    if number < 1 or max(retained) >= most:
        return full, retained, 0
    modes = full.modes.take(list(range(most)))
    exchange_1_s = _exchange_1_s(modes, full.steady.exchanges)
    stiff = np.diag(modes.decay_1_s[dropped]) + exchange_1_s[np.ix_(dropped, dropped)]
    forced = np.linalg.solve(stiff, exchange_1_s[np.ix_(dropped, retained)])
    # without an uneven exchange, the slowest dropped modes
    slowest = FAINT * np.diag(modes.decay_1_s[dropped[0]] / modes.decay_1_s[dropped])
    shapes = np.linalg.svd(np.hstack([forced, slowest]), full_matrices=False)[0][:, :number]
    decay_1_s, turn = np.linalg.eigh(shapes.T @ (modes.decay_1_s[dropped, None] * shapes))
    combined = np.eye(most)[:, [*retained, *range(number), *dropped]]
    bent = slice(len(retained), len(retained) + number)
    combined[:, bent] = 0.0
    combined[dropped, bent] = _pointed(shapes @ turn)
    rates_1_s = np.concatenate([modes.decay_1_s[retained], decay_1_s, modes.decay_1_s[dropped]])
    modes = replace(modes, decay_1_s=rates_1_s, mix=combined if modes.mix is None else modes.mix @ combined)
    known_inputs = tuple(k._replace(modal=k.modal[:most] @ combined) for k in full.known_inputs)
    return replace(full, modes=modes, known_inputs=known_inputs), list(range(bent.stop)), number


def _pointed(shapes: FloatArray) -> FloatArray:
    """The shapes (n, k) with the sign that makes the largest entry of each positive."""
    largest = shapes[np.argmax(np.abs(shapes), axis=0), np.arange(shapes.shape[1])]
    return np.asarray(shapes * np.sign(largest))


def _exchange_1_s(modes: Modes, exchanges: Sequence[Exchange]) -> FloatArray:
    """The exchange (N, N) of modes under nuts that sweep, with their nodes at 0 °C."""
    exchange = np.zeros((len(modes), len(modes)))
    for _, conductance_W_K, stroke in exchanges:
        theta, weights = shapes_within(modes, stroke)
        per_K = conductance_W_K / (modes.rod.conductance_W_m * stroke.width_m)
        exchange += (theta * (per_K * weights)[:, None]).T @ theta
    return exchange
