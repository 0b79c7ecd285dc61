"""Conjugate gradients: over the whole history at once, or step by step as Lathe printed them.

The function `descend` minimises |Z - H S w|² from w = 0, with H S as sweeps of the plant. One sweep forward
gives the change of the readings along a direction, one back the exact gradient. This replaces two simulations
for each unknown. The number of iterations regularises. The descent ends when the misfit is at the noise level
or no longer improves. Sources: direction, factor and step of Lathe's equations 13 to 17, for a linear plant
those of Fletcher and Reeves (1964); the discrepancy principle of Alifanov (1974).

Neither gives a covariance: `spread` estimates their errors from simulated logs with known heats.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from observer.errors import UserError
from observer.estimators.packing import IntArray
from observer.frames import BoolArray, FloatArray
from observer.history.sweeps import Readings, Sweeps
from observer.model.discretise import quantise, step_matrices
from observer.model.plant import Plant

_ITERATIONS = 1000
_REST = 1e-10
_STEP_ITERATIONS, _STEP_REST, _DIFFERENCE_W = 50, 1e-20, 1.0
_PATIENCE, _WORTH_IT = 20, 1e-2
"""A descent continues while twenty iterations still lower the misfit by a hundredth."""


class Descent(NamedTuple):
    """The results of c descents; heats and readings are relative to the expected ones.

    Attributes:
        heat_W: Heats, W, (K, m_e, c).
        rows_K: Readings with these heats, K, (K, s, c).
        misfit: |Z - H Q|², (c,), in units of the noise's variance.
        iterations: Number of iterations, (c,).
        reached: Whether the misfit reached the noise level, (c,).
    """

    heat_W: FloatArray
    rows_K: FloatArray
    misfit: FloatArray
    iterations: IntArray
    reached: BoolArray


def refuse_bent(plant: Plant) -> None:
    """Refuse a plant whose readings are not linear in the heats.

    Raises:
        UserError: If the plant has radiation, natural convection, or friction that fades with temperature.
    """
    c = plant.coupling
    if c.radiation > 0.0 or c.rising > 0.0 or c.fades.per_K.any():
        raise UserError(
            "conjugate-gradient needs temperatures that are linear in the heats, but an [[effect]] adds "
            "radiation, natural convection or fading friction; use --method smoother"
        )


def descend(
    sweeps: Sweeps,
    weight_1_K: FloatArray,
    rise_K: FloatArray,
    progress: Callable[[str], None] = lambda _text: None,
) -> Descent:
    """Return the first iterates towards the minima of |Z - H S w|² that explain each Z to its noise level.

    The noise level is M + 2 √(2 M) for M values: 95 % of logs are below it. A descent also ends if twenty
    iterations lower its misfit by less than 1 %.

    Args:
        sweeps: H S of the log.
        weight_1_K: One over the noise of each reading, 1/K, (K, s), 0 without a measurement.
        rise_K: Readings Z of c logs, relative to the expected ones, K, (K, s, c). Each has its own descent.
        progress: Called before each iteration with a text about the log that is furthest from its end.
    """
    c, values = rise_K.shape[2], np.count_nonzero(weight_1_K)
    # white noise of variance 1 has a square of M ± √(2 M); 95 % of logs are below this
    enough = values + 2.0 * np.sqrt(2.0 * values)
    V, count, going = np.zeros((sweeps.unknowns, c)), np.zeros(c, np.int64), np.arange(c)
    way = _Way.at_start(sweeps, weight_1_K, rise_K)
    misfit, past = way.misfit.copy(), [way.misfit]
    for k in range(_ITERATIONS):
        continues = past[-1] > enough
        if len(past) > _PATIENCE:
            continues &= past[-1] <= (1.0 - _WORTH_IT) * past[-1 - _PATIENCE]
        continues &= way.steepness > _REST**2 * way.first
        if not continues.any():
            break
        if not continues.all():
            going, way, past = (
                going[continues],
                way.of(continues),
                [m[continues] for m in past[-1 - _PATIENCE :]],
            )
        far = float(np.sqrt(past[-1].max() / max(values, 1)))
        progress(f"iteration {k + 1}, {len(going)} of {c} logs left, the furthest at {far:.3g} × its noise")
        V[:, going] += way.step(sweeps, weight_1_K)
        misfit[going] = way.misfit
        count[going] += 1
        past.append(way.misfit)
    return Descent(*sweeps.forward(V), misfit, count, misfit <= enough)


class _Way:
    """The state of c descents: the weighted error (K, s, c), the gradient and the direction (n, c)."""

    def __init__(self, error: FloatArray, gradient: FloatArray) -> None:
        self.error, self._gradient, self._direction = error, gradient, gradient
        self.misfit, self.steepness = _squares(error), _squares(gradient)
        self.first = self.steepness

    @classmethod
    def at_start(cls, sweeps: Sweeps, weight_1_K: FloatArray, rise_K: FloatArray) -> _Way:
        """Return the start: no heat beyond the expected one."""
        weight = weight_1_K[:, :, None]
        return cls(weight * rise_K, sweeps.adjoint(weight**2 * rise_K))

    def of(self, selected: BoolArray) -> _Way:
        """Return some of the descents."""
        way = _Way(self.error[:, :, selected], self._gradient[:, selected])
        way._direction, way.first = self._direction[:, selected], self.first[selected]
        return way

    def step(self, sweeps: Sweeps, weight_1_K: FloatArray) -> FloatArray:
        """Go to the lowest point along the direction; return the change of the unknowns (n, c)."""
        weight, before = weight_1_K[:, :, None], self.steepness
        change = weight * sweeps.forward(self._direction)[1]
        along = np.einsum("nc,nc->c", self._gradient, self._direction)
        moved = (along / _squares(change)) * self._direction
        self.error = self.error - (along / _squares(change)) * change
        self._gradient = sweeps.adjoint(weight * self.error)
        self.misfit, self.steepness = _squares(self.error), _squares(self._gradient)
        self._direction = self._gradient + (self.steepness / before) * self._direction
        return np.asarray(moved)


def _squares(columns: FloatArray) -> FloatArray:
    """Return the sum of squares (c,) of each column of the last axis."""
    flat = columns.reshape(-1, columns.shape[-1])
    return np.asarray(np.einsum("nc,nc->c", flat, flat))


REPLICAS, REPLICAS_LONG, LONG = 24, 4, 3000
"""How many logs are drawn; fewer for a log of more than 3000 steps, which averages by itself."""
_SMOOTHED_SHARE = 0.05


class Drawn(NamedTuple):
    """c logs drawn from the configured prior, relative to the expected heats and readings.

    Attributes:
        heat_W: Heats, W, (K, m_e, c).
        rise_K: Readings with noise, K, (K, s, c).
    """

    heat_W: FloatArray
    rise_K: FloatArray


def draw(walk: Sweeps, weight_1_K: FloatArray, seed: int) -> Drawn:
    """Return 24 drawn logs, or 4 long ones: heats, initial field and noise.

    They have the length and the missing values of the log.

    Args:
        walk: Sweeps with the prior of order 1.
        weight_1_K: One over the noise of each reading, 1/K, (K, s), 0 without a measurement.
        seed: Seed of the random numbers.
    """
    rng = np.random.default_rng(seed)
    replicas = REPLICAS if walk.rows <= LONG else REPLICAS_LONG
    heat, rows = walk.forward(rng.standard_normal((walk.unknowns, replicas)))
    used = (weight_1_K > 0.0)[:, :, None]
    noise_K = 1.0 / np.where(weight_1_K > 0.0, weight_1_K, 1.0)[:, :, None]
    return Drawn(heat, np.where(used, rows + noise_K * rng.standard_normal(rows.shape), 0.0))


def spread(drawn: Drawn, found_W: FloatArray) -> FloatArray:
    """Return the root mean square error of estimated heats, W, (K, m_e), smoothed over 5 % of the log.

    The error includes noise, early stopping and missing sensors, as far as the configured random walk
    describes this machine's heats.

    Args:
        drawn: The drawn logs.
        found_W: Heats estimated from them, W, (K, m_e, c).
    """
    return np.sqrt(_smoothed(np.mean((found_W - drawn.heat_W) ** 2, axis=2)))


def _smoothed(variance: FloatArray) -> FloatArray:
    """Return running means over a twentieth of the log: a few replicas give a variance to 30 % at best."""
    reach = max(int(_SMOOTHED_SHARE * len(variance)) // 2, 1)
    total = np.vstack([np.zeros((1, variance.shape[1])), np.cumsum(variance, axis=0)])
    row = np.arange(len(variance))
    low, high = np.maximum(row - reach, 0), np.minimum(row + reach + 1, len(variance))
    return np.asarray((total[high] - total[low]) / (high - low)[:, None])


def stepwise(plant: Plant, log: Readings) -> Callable[[FloatArray], tuple[FloatArray, FloatArray]]:
    """Return a function that finds heats step by step.

    At step n only q_n is unknown. J_n = Σ_i (T_i(q) - y_i)² is minimised by conjugate gradients from the
    heats of the step before, until J_n is at the noise level; then the step is final. Nothing links the
    steps. So each must be long enough for heat to reach the sensors, or noise is taken for heat. The gradient
    is that of central differences of 1 W, as printed. Source: Lathe's equations 11 to 17.

    Args:
        plant: The model, without couplings that change in time.
        log: Readings of the log with the prior of order 0.

    Returns:
        A function from Z, K, (K, s), to heats, W, (K, m_e), and the readings with them, K, (K, s).

    Raises:
        UserError: If the plant's states are coupled in time.
    """
    if plant.coupling.active:
        raise UserError(
            "--gradient central-differences needs a machine that does not change in time, but a body moves "
            "with a nut, or an [[effect]] depends on speed, temperature or time; use --gradient adjoint, or "
            "--method smoother"
        )
    plant, u = plant.sensors_only(), log.inputs
    lengths_s, index = np.unique(quantise(u.dt_s), return_inverse=True)
    steps = [step_matrices(plant, float(dt_s)) for dt_s in lengths_s]
    estimated_nuts = [(int(np.sum(plant.estimated[: m.index])), m) for m in plant.moving]
    input_columns, C = plant.B[:, plant.estimated].copy(), plant.rows.C.copy()

    def find(rise_K: FloatArray) -> tuple[FloatArray, FloatArray]:
        x, q = np.zeros(len(input_columns)), np.zeros(input_columns.shape[1])
        heat, rows = np.zeros((len(u), len(q))), np.zeros_like(rise_K)
        for k in range(1, len(u)):
            step = steps[index[k]]
            for i, (j, source) in enumerate(estimated_nuts):
                C[:, plant.modes + source.index] = u.moving_C[k, i]
                if plant.estimated[source.index]:
                    input_columns[:, j] = u.moving_B[k, i]
            x, columns = step.decay * x, step.hold[:, None] * input_columns
            used = log.weight_1_K[k] > 0.0
            off_K, G = (C @ x - rise_K[k])[used], (C @ columns)[used]
            q = _descend_step(G, off_K, q, float(np.sum(log.weight_1_K[k][used] ** -2.0)))
            x += columns @ q
            heat[k], rows[k] = q, C @ x
        heat[0] = heat[1]
        return heat, rows

    return find


def _descend_step(G: FloatArray, off_K: FloatArray, q: FloatArray, enough_K2: float) -> FloatArray:
    """Return the q for which |off + G q|² is at the noise level, or as small as fifty iterations make it."""

    def misfit_K2(q: FloatArray) -> float:
        error_K = off_K + G @ q
        return float(error_K @ error_K)

    direction, before, first = np.zeros_like(q), 0.0, 0.0
    apart = _DIFFERENCE_W * np.eye(len(q))
    for _ in range(_STEP_ITERATIONS):
        if misfit_K2(q) <= enough_K2:
            break
        gradient = np.array([misfit_K2(q + d) - misfit_K2(q - d) for d in apart]) / (2.0 * _DIFFERENCE_W)
        steepness = float(gradient @ gradient)
        first = first or steepness
        if steepness <= _STEP_REST * first:
            break
        direction = gradient + (steepness / before if before else 0.0) * direction
        change_K = G @ direction
        along = float(change_K @ change_K)
        q = q - (float((off_K + G @ q) @ change_K) / along if along > 0.0 else 0.0) * direction
        before = steepness
    return q
