"""A whole log as one linear equation, Z = H Q: stationary plants, an even step, heats constant over each
step.

Row k of Z is the sensor readings at step k above the free response of the screw, element l of Q the heats
over step l + 1. Every row is weighted by its sensor's noise, and the unknown initial field is marginalised
under its prior:

|Z - H Q|² = (Z - H Q)ᵀ (R + U Uᵀ)⁻¹ (Z - H Q),    U = C exp(-decay t) √P₀.

H is block Toeplitz and is kept as its first block column, the response to one watt held over one step.
Source: Li et al. (2022), equations 28 to 31, with a known initial field; in modes here, not in nodes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from observer.errors import UserError
from observer.frames import BoolArray, FloatArray, Inputs
from observer.model.discretise import step_matrices
from observer.model.plant import Plant
from observer.model.simulate import simulate

_UNEVEN = 0.02
"""Largest relative difference of steps that still count as even."""
_NEGLIGIBLE = 1e-10
_CHUNK = 4096


class Prior(NamedTuple):
    """The prior of the heats: q_l = keep q_{l-1} + a step of `step_W`, with `first_W` for the first.

    All (m_e,). Order 1 is the plant's own random walk; in order 0 each step's heat is independent.
    """

    keep: FloatArray
    step_W: FloatArray
    first_W: FloatArray

    @classmethod
    def of(cls, plant: Plant, dt_s: float, order: int) -> Prior:
        """Return the prior of a plant's estimated heats at a step."""
        sigma_W = plant.initial_sigma_W
        if order == 0:
            return cls(np.zeros(len(sigma_W)), sigma_W, sigma_W)
        step = step_matrices(plant, dt_s)
        first_W = np.sqrt(step.heat_decay**2 * sigma_W**2 + step.walk_dd)
        return cls(step.heat_decay, np.sqrt(step.walk_dd), first_W)

    def heats(self, w: FloatArray) -> FloatArray:
        """Return the heats (T, m_e, …) of independent numbers w of variance 1 of the same shape."""
        heat = w * _over_heats(self.step_W, w)
        heat[0] = w[0] * _over_heats(self.first_W, w)[0]
        return accumulate(heat, self.keep)

    def adjoint(self, gradient: FloatArray) -> FloatArray:
        """Return the gradient by w from that by the heats, (T, m_e, …)."""
        back = accumulate(gradient[::-1].copy(), self.keep)[::-1]
        first = back[0] * _over_heats(self.first_W, back)[0]
        back = back * _over_heats(self.step_W, back)
        back[0] = first
        return back


class StackedProblem(NamedTuple):
    """The equation of one log with K rows, s sensors and m_e heats over T = K - 1 steps.

    `time_s` (K,); `dt_s`; `response_K_W` (T, s, m_e), the temperatures at the ends of steps 1, 2, … after one
    watt over step 1; `rise_K` (K, s), Z, 0 where there is no measurement; `weight_1_K` (K, s), one over the
    noise, 0 where there is no measurement; `start` (K s, r), an orthonormal basis of the initial field's
    effect on the weighted rows, and `discount` (r,), the share of each attributed to it.
    """

    time_s: FloatArray
    dt_s: float
    response_K_W: FloatArray
    rise_K: FloatArray
    weight_1_K: FloatArray
    start: FloatArray
    discount: FloatArray

    @property
    def steps(self) -> int:
        """T, the number of steps over which heats are unknown."""
        return len(self.response_K_W)

    @property
    def heats(self) -> int:
        """m_e, the number of estimated heats."""
        return int(self.response_K_W.shape[2])

    @property
    def measurements(self) -> int:
        """The number of values; with the correct heats |Z - H Q|² is about this."""
        return int(np.count_nonzero(self.weight_1_K))

    def whiten(self, rows: FloatArray) -> FloatArray:
        """Weight rows (K, s, …) so that noise and initial field together have variance 1.

        (I + U Uᵀ)^(-1/2) R^(-1/2), which is symmetric but for the weights.
        """
        scaled = rows * self.weight_1_K.reshape(self.weight_1_K.shape + (1,) * (rows.ndim - 2))
        return self._less(self.discount, scaled)

    def whiten_adjoint(self, rows: FloatArray) -> FloatArray:
        """Return the adjoint of `whiten` for rows (K, s)."""
        return np.asarray(self._less(self.discount, rows.copy()) * self.weight_1_K)

    def unexplained(self, rows_K: FloatArray) -> FloatArray:
        """Return what rows Z - H Q (K, s), K, hold beyond the most probable initial field."""
        weighted = self._less(1.0 - (1.0 - self.discount) ** 2, rows_K * self.weight_1_K)
        used = self.weight_1_K > 0.0
        return np.where(used, weighted / np.where(used, self.weight_1_K, 1.0), np.nan)

    def draw_start(self, rng: np.random.Generator) -> FloatArray:
        """Return the sensor readings of an initial field drawn from its prior, above its mean, (K, s), K."""
        size = np.sqrt(1.0 / (1.0 - self.discount) ** 2 - 1.0)
        weighted = (self.start @ (size * rng.standard_normal(len(size)))).reshape(self.weight_1_K.shape)
        used = self.weight_1_K > 0.0
        return np.where(used, weighted / np.where(used, self.weight_1_K, 1.0), 0.0)

    def _less(self, share: FloatArray, weighted: FloatArray) -> FloatArray:
        """Subtract from weighted rows, in place, these shares (r,) of the initial field's effect."""
        flat = weighted.reshape(len(self.start), -1)
        flat -= self.start @ (share[:, None] * (self.start.T @ flat))
        return flat.reshape(weighted.shape)


def stacked_problem(
    plant: Plant, blocks: Sequence[Inputs], *, start_known: bool = False
) -> tuple[StackedProblem, int]:
    """Return the equation of a log and the number of its first row, before which nothing was measured.

    With `start_known` the screw has one temperature initially, as in the papers; otherwise its field is
    uncertain by the plant's prior. A moving source is spread over its stroke. The laws of the estimated heats
    are not used. Raises `UserError` where effects couple the plant's states, the steps are uneven or there
    are too few.
    """
    if plant.coupling.active:
        raise UserError(
            "a body rides on a nut that moves, or an effect changes the plant with speed, temperature or "
            "time, and this method needs one that stays as it is; use --method smoother"
        )
    still = [b._replace(moving_B=b.moving_B[:, :0], moving_C=b.moving_C[:, :0]) for b in blocks]
    inputs = Inputs.joined(still)
    known = np.isfinite(inputs.z_end).all(axis=1) & np.isfinite(inputs.z_start).all(axis=1)
    usable = inputs.usable & np.isfinite(inputs.y_degC)
    ready = np.flatnonzero(known & usable.any(axis=1))
    if not len(ready) or ready[0] > len(inputs) - 3:
        raise UserError("the log holds fewer than three steps with a measurement; record for longer")
    first = int(ready[0])
    inputs, usable = inputs.part(first), usable[first:]
    dt_s = _even_step(inputs.dt_s[1:])
    plant = stationary(plant)
    decay = np.exp(-plant.decay_1_s * dt_s)
    s = plant.rows.sensors
    held = step_matrices(plant, dt_s).hold[:, None] * plant.B[:, plant.estimated]
    weight = np.where(usable, 1.0 / np.sqrt(plant.noise_R_K2), 0.0)
    rise = np.where(usable, inputs.y_degC - _free_response(plant, inputs, usable[0]), 0.0)
    start, discount = _start_basis(plant, decay, weight)
    if start_known:
        start, discount = start[:, :0], discount[:0]
    return (
        StackedProblem(
            time_s=inputs.time_s,
            dt_s=dt_s,
            response_K_W=_powers(plant.rows.C[:s], decay, held, len(inputs) - 1),
            rise_K=rise,
            weight_1_K=weight,
            start=start,
            discount=discount,
        ),
        first,
    )


def stationary(plant: Plant) -> Plant:
    """Return the plant with its moving sources spread over their strokes, and the sensors' rows only."""
    return replace(plant, moving=()).sensors_only()


def accumulate(values: FloatArray, keep: FloatArray) -> FloatArray:
    """Return the running sums v_l + keep v_{l-1} + keep² v_{l-2} + … in place, along the first axis.

    `values` (T, m_e, …), `keep` (m_e,).
    """
    if (keep == 1.0).all():
        return np.cumsum(values, axis=0, out=values)
    if keep.any():
        factor = _over_heats(keep, values)[0]
        for step in range(1, len(values)):
            values[step] += factor * values[step - 1]
    return values


def start_mean(plant: Plant, inputs: Inputs, usable: BoolArray) -> FloatArray:
    """Return the state (n_x,) that the Kalman filter starts from, before its first correction.

    A screw of one temperature, the median of the usable sensors (s,), its lags at rest under their laws.
    """
    s = plant.rows.sensors
    x = inputs.law_W[0] @ plant.lags
    C = plant.rows.C[:s]
    y = inputs.y_degC[0] - plant.rows.F[:s] @ inputs.z_end[0]
    seen = C @ plant.uniform
    level = np.where(seen > 0.5, (y - C @ x) / np.where(seen > 0.5, seen, 1.0), inputs.y_degC[0])
    return np.asarray(x + plant.uniform * np.median(level[usable]))


def _even_step(dt_s: FloatArray) -> float:
    usual_s = float(np.median(dt_s))
    if np.abs(dt_s - usual_s).max() > _UNEVEN * usual_s:
        raise UserError(
            f"the log's steps are uneven, {dt_s.min():.6g} to {dt_s.max():.6g} s, and this method needs an "
            "even step; use --method smoother"
        )
    return float(dt_s.mean())


def _free_response(plant: Plant, inputs: Inputs, usable: BoolArray) -> FloatArray:
    """The sensors (K, s) as they would read without the estimated heats."""
    x = start_mean(plant, inputs, usable)
    laws = np.where(plant.estimated, 0.0, inputs.law_W)
    first = plant.rows.C @ x + plant.rows.F @ inputs.z_end[0]
    _, rows = simulate(plant, x, inputs._replace(law_W=laws).part(1))
    return np.vstack([first, rows])


def _powers(C: FloatArray, decay: FloatArray, columns: FloatArray, steps: int) -> FloatArray:
    """C decay^k columns for k = 0 … steps - 1, (steps, s, c)."""
    pairs = (C[:, None, :] * columns.T).reshape(-1, len(decay)).T
    out = np.empty((steps, pairs.shape[1]))
    powers = decay ** np.arange(min(steps, _CHUNK))[:, None]
    for begin in range(0, steps, _CHUNK):
        part = out[begin : begin + _CHUNK]
        part[:] = powers[: len(part)] @ (decay[:, None] ** begin * pairs)
    return out.reshape(steps, len(C), columns.shape[1])


def _start_basis(plant: Plant, decay: FloatArray, weight: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Orthonormal columns (K s, r) of the weighted U, and 1 - 1/√(1 + size²) of each."""
    values, vectors = np.linalg.eigh(plant.prior_P)
    kept = values > _NEGLIGIBLE * max(float(values[-1]), 1e-300)
    U = _powers(plant.rows.C, decay, vectors[:, kept] * np.sqrt(values[kept]), len(weight))
    U *= weight[:, :, None]
    U = U.reshape(weight.size, -1)
    square, turn = np.linalg.eigh(U.T @ U)
    significant = square > _NEGLIGIBLE * max(1.0, float(square[-1]) if len(square) else 0.0)
    square, turn = square[significant], turn[:, significant]
    return U @ (turn / np.sqrt(square)), 1.0 - 1.0 / np.sqrt(1.0 + square)


def _over_heats(per_heat: FloatArray, values: FloatArray) -> FloatArray:
    """Per-heat numbers in the shape that multiplies values (T, m_e, …)."""
    return per_heat.reshape((1, -1) + (1,) * (values.ndim - 2))
