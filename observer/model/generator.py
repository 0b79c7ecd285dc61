"""A coupled plant as one matrix, dx/dt = A x + B q + E z, and in its own modes, x = V ξ.

Links at fixed places, films along stretches and sensors that lag make the generator a full matrix. In its own
modes it is diagonal again, so that a step is exact and as cheap as that of a screw alone. Couplings that
vary in time (moving nuts, films of speed, radiation) are left to the step (`coupling`). Designs take
the whole matrix, with nuts over their strokes.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from observer.errors import ConfigError
from observer.frames import FloatArray
from observer.kernels.layout import packed
from observer.model.coupling import Coupling, no_coupling
from observer.model.discretise import StepMatrices, augmented
from observer.model.plant import OFFSET, Basis, Plant

if TYPE_CHECKING:
    import control

_LONGEST = 16.0
"""Step times norm up to which one exponential is taken; its noise loses exp of that in digits."""


def generator(plant: Plant) -> FloatArray:
    """Return A (n_x, n_x), 1/s, with moving nuts over their strokes.

    It has decay, the links of moving nuts, and their exchange beyond the mean.
    """
    c, n_x, N = plant.coupling, len(plant.decay_1_s), plant.modes
    A = -np.diag(plant.decay_1_s)
    metric = c.metric if plant.basis is not None else np.diag(np.arange(n_x) < N).astype(float)
    for i, source in enumerate(c.links.source.tolist()):
        foot = c.place_gain[source] * plant.B[:, source]
        under = c.under_C[source] + c.conductance_W_m * (metric @ foot)
        A += c.links.conductance_W_K[i] * np.multiply.outer(foot - c.links.B[i], c.links.C[i] - under)
    width = c.spreads.row.shape[1]
    A[:width, :width] -= (c.spreads.into.T * c.spreads.rate_1_s) @ c.spreads.row
    return A


def on_the_screw(plant: Plant) -> FloatArray:
    """Return the projection (n_x, n_x) of the states on the modes of the screw.

    For a screw with sections, it is weighted by the loss of its film, relative to its own diameter and bore.
    """
    n_x, uneven = len(plant.decay_1_s), plant.coupling.uneven
    if len(uneven.rate):
        return np.asarray((uneven.into.T * uneven.rate) @ uneven.row)
    if plant.basis is None:
        return np.diag(np.arange(n_x) < plant.modes).astype(float)
    V, inverse, _ = plant.basis
    return np.asarray(inverse[:, : plant.modes] @ V[: plant.modes])


def settled_rows(plant: Plant) -> FloatArray:
    """Return the rows of screw and sources, (R, N + m), after nodes and lagging sensors have followed."""
    first = plant.lag_slice.stop
    if len(plant.decay_1_s) == first:
        return plant.rows.C
    A, C = generator(plant), plant.rows.C
    follow = np.linalg.lstsq(A[first:, first:], -A[first:, :first], rcond=None)[0]
    return np.asarray(C[:, :first] + C[:, first:] @ follow)


def design_step(plant: Plant, step: StepMatrices) -> tuple[FloatArray, FloatArray]:
    """Return transition and noise (n, n) of [x | δ] for a design, with the constant couplings."""
    return augmented_step(plant, step.dt_s) if len(plant.coupling.links.source) else augmented(plant, step)


def augmented_step(plant: Plant, dt_s: float) -> tuple[FloatArray, FloatArray]:
    """Return transition and noise (n, n) of [x | δ] over a step, δ the estimated heats' deviations.

    Source: Van Loan (1978), eq. 1.2: exp of [[−A, Q], [0, Aᵀ]] holds both. As exp(−A dt) grows without limit,
    a long step is made of short ones.
    """
    from scipy.linalg import expm  # noqa: PLC0415  (start-up: designs alone need it)

    n_x, m_e = len(plant.decay_1_s), int(plant.estimated.sum())
    n = n_x + m_e
    block = np.zeros((2 * n, 2 * n))
    block[n : n + n_x, n : n + n_x] = generator(plant).T
    block[n + n_x :, n : n + n_x] = plant.B[:, plant.estimated].T
    block[n + n_x :, n + n_x :] = -np.diag(plant.heat_decay_1_s)
    block[:n, :n] = -block[n:, n:].T
    block[:n_x, n : n + n_x] = plant.field_noise_Q
    block[n_x:n, n + n_x :] = np.diag(plant.random_walk_W2_s)
    norm = float(np.linalg.norm(block, 1)) * dt_s
    halvings = math.ceil(math.log2(max(norm / _LONGEST, 1.0)))
    whole = expm(block * (dt_s / 2**halvings))
    Ad = whole[n:, n:].T
    Qd = Ad @ whole[:n, n:]
    for _ in range(halvings):
        Qd = Qd + Ad @ Qd @ Ad.T
        Ad = Ad @ Ad
    return np.asarray(Ad), np.asarray(0.5 * (Qd + Qd.T))


def state_space(plant: Plant) -> control.StateSpace:
    """Return the plant with fixed footprints as a continuous-time system with named inputs and outputs.

    Inputs are the heats in W and the known inputs. Outputs are the rows in °C and µm. A moving nut is spread
    over its stroke. Losses that change with speed or temperature are left out. For design and study with
    python-control; the estimators step the plant by their own exact formulas. Raises `ConfigError` if the
    thermal error is nonlinear.
    """
    import control  # noqa: PLC0415  (takes two seconds: only who asks for it pays)

    rows, first = plant.rows, plant.lag_slice.stop
    outputs = output_names(plant)
    if len(outputs) != len(rows.C):
        raise ConfigError(
            "supports: with pre-tension or a gap the thermal error is no linear output; leave [supports] out "
            "of the configuration that this is asked of"
        )
    states = [*(f"mode_{n}" for n in plant.mode_index), *(f"lag_{name}" for name in plant.source_names)]
    states += [f"beside_{i + 1}" for i in range(len(plant.decay_1_s) - first)]
    if plant.basis is not None:
        states = [f"own_mode_{i + 1}" for i in range(len(states))]
    inputs = [*(f"heat_{name}_W" for name in plant.source_names), *known_columns(plant)]
    return control.ss(
        generator(plant),
        np.hstack([plant.B, plant.E]),
        rows.C,
        np.hstack([np.zeros((len(rows.C), len(plant.source_names))), rows.F]),
        states=_without_dots(states),
        inputs=_without_dots(inputs),
        outputs=_without_dots(outputs),
    )


def output_names(plant: Plant) -> list[str]:
    """Names of the output rows with their units, those along the screw as in `estimates.csv`."""
    places = np.zeros((1, plant.rows.grid))
    return [
        *(f"sensor_{name}_degC" for name in plant.layout.sensors),
        *plant.layout.along(field__degC=places),
        *(plant.layout.along(error__um=places) if plant.layout.has_error else ()),
        *(("growth_um",) if plant.layout.has_force else ()),
    ]


def known_columns(plant: Plant) -> tuple[str, ...]:
    """Names of the known inputs with their units."""
    return tuple(f"{name}_{'K' if name.startswith(OFFSET) else 'degC'}" for name in plant.known_names)


def _without_dots(names: Sequence[str]) -> list[str]:
    """Names as control allows them."""
    return [name.replace(".", "_") for name in names]


APART = 1e-8
"""Relative spacing of the equal rates of the sources' lags, and of those of sensors."""


class Constant(NamedTuple):
    """Constant couplings of a plant's states, added to the plant's own.

    Attributes:
        A: Coupling of the states, 1/s, (n_x, n_x).
        E: Coupling with the known inputs, 1/s, (n_x, p).
        follow: Numbers of the states that follow others and act on none.
    """

    A: FloatArray
    E: FloatArray
    follow: tuple[int, ...] = ()


def diagonalised(plant: Plant, constant: Constant) -> Plant:
    """Return the plant in its own modes, which include its constant couplings."""
    plant = replace(plant, E=plant.E + constant.E)
    if not constant.A.any():
        return plant
    return turned(plant, *own_modes(plant, constant.A - np.diag(plant.decay_1_s), constant.follow))


def own_modes(plant: Plant, A: FloatArray, follow: tuple[int, ...] = ()) -> tuple[FloatArray, FloatArray]:
    """Return V (n_x, n_x) of a generator A (n_x, n_x), and the decay rates (n_x,) of its columns, 1/s.

    Screw, nodes and lags are passive, and sensors only follow: the rates are real. Each mode has the number
    of the state with the largest part in it (Pérez-Arriaga et al. 1982), and is 1 there.
    """
    from scipy.optimize import linear_sum_assignment  # noqa: PLC0415  (start-up: a screw alone needs none)

    alike = [*range(len(A))[plant.lag_slice], *follow]
    A = A.copy()
    A[alike, alike] *= 1.0 + APART * np.arange(len(alike))
    rates, V = np.linalg.eig(A)
    rates, V = rates.real, V.real
    state, mode = linear_sum_assignment(-np.abs(V * np.linalg.inv(V).T))
    V = V[:, mode[np.argsort(state)]]
    return V / np.diag(V), np.maximum(-rates[mode[np.argsort(state)]], 0.0)


def turned(plant: Plant, V: FloatArray, decay_1_s: FloatArray) -> Plant:
    """Return the plant with the states ξ, x = V ξ, which decay at `decay_1_s` (n_x,)."""
    basis = Basis(V, np.asarray(np.linalg.inv(V), dtype=np.float64), plant.decay_1_s)
    inverse = basis.inverse

    def both(P: FloatArray) -> FloatArray:
        return np.asarray(inverse @ P @ inverse.T)

    learning = plant.learning
    if learning is not None:
        arrays = learning.arrays.in_basis(V, inverse)
        learning = replace(learning, arrays=arrays._replace(rest_P=both(arrays.rest_P)))
    rows = replace(plant.rows, C=plant.rows.C @ V)
    # what a row sees of a moving nut's lag beside the lag itself stays as the nut moves
    moving = []
    for s in plant.moving:
        lag = plant.modes + s.index
        fixed_part = rows.C[:, lag] - plant.rows.C[:, lag] * V[lag, lag]
        turn = inverse @ s.table.turn if len(s.table.turn) else inverse
        moving.append(
            s.with_table(turn=turn, table_C=s.table.table_C + fixed_part, mean_C=s.table.mean_C + fixed_part)
        )
    return replace(
        plant,
        decay_1_s=decay_1_s,
        B=inverse @ plant.B,
        E=inverse @ plant.E,
        rows=rows,
        moving=tuple(moving),
        uniform=inverse @ plant.uniform,
        prior_P=both(plant.prior_P),
        smooth_P=both(plant.smooth_P),
        field_noise_Q=both(plant.field_noise_Q),
        coupling=_coupling(plant, basis),
        learning=learning,
        basis=basis,
    )


def _coupling(plant: Plant, basis: Basis) -> Coupling:
    """The time-varying couplings in the new states."""
    c, (V, inverse, _) = plant.coupling, basis
    N, other_states = plant.modes, np.arange(plant.modes, len(V))
    links = c.links._replace(C=c.links.C @ V, B=c.links.B @ inverse.T)
    spreads = c.spreads._replace(row=c.spreads.row @ V[:N], into=c.spreads.into @ inverse[:, :N].T)
    coupling: Coupling = packed(
        c._replace(
            metric=V[:N].T @ V[:N],
            non_modal_rows=V[other_states],
            non_modal_into=inverse[:, other_states].T,
            under_C=c.under_C @ V,
            uniform=inverse @ c.uniform,
            mean=c.mean @ V,
            links=links,
            spreads=spreads,
            uneven=c.uneven._replace(row=c.uneven.row @ V, into=c.uneven.into @ inverse.T),
        )
    )
    return coupling


def frozen(plant: Plant) -> tuple[Plant, FloatArray]:
    """Return an uncoupled plant in its own modes, and V (n_x, n_x), its states in the plant's.

    Nuts are over their strokes, and time-varying losses are left out. For designs that place poles.
    """
    uncoupled = no_coupling(
        len(plant.decay_1_s), len(plant.source_names), len(plant.known_names), plant.modes
    )
    V, decay_1_s = own_modes(plant, generator(plant))
    return turned(replace(plant, moving=(), learning=None, coupling=uncoupled), V, decay_1_s), V
