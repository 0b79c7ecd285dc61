"""Steps of a design's plant along a shift: transitions, noise, and rows of the sensors.

Steps are longer than an estimator's. Nuts sweep over their strokes within a step, and readings ripple by
phases of the sweep (`cycle.ripple`). The effects of nuisance parameters are linearised along the field that
the shift makes.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from scipy.linalg import expm

from observer.estimators.design.steady import standing
from observer.frames import FloatArray
from observer.model.cycle import SWEEP_PHASES, Stage, ripple
from observer.model.generator import augmented_step, generator, on_the_screw
from observer.model.learning import WANDER_S, LearningArrays, Nuisance
from observer.model.plant import Plant

_LONGEST = 16.0  # a step in the plant's shortest time, beyond which its exponential is made of halves


class Along(NamedTuple):
    """A step along a shift.

    With n states [x | δ | θ] of an estimator, s sensors, m_e estimated heats and f phases of a sweep.

    Attributes:
        plant: The model with standing nuts in place.
        stage: The stage of the shift.
        x: States of the plant after the step, (n_x,).
        F: Transition of [x | δ | θ], (n, n); the iterator overwrites it at the next step.
        Q: Noise of [x | δ], (n_x + m_e, n_x + m_e).
        jump_W: Jump of the laws of estimated heats just before the step, W, (m_e,).
        H: Rows of the mean readings, (s, n), overwritten at the next step.
        passing: Ripple of the rows as nuts pass, (f, s, n), one phase of zeros without sweeps.
    """

    plant: Plant
    stage: Stage
    x: FloatArray
    F: FloatArray
    Q: FloatArray
    jump_W: FloatArray
    H: FloatArray
    passing: FloatArray


class _StageStep(NamedTuple):
    """A step of [x | δ] within a stage: transition `A` and noise `Q` (n, n).

    The integral of the transition over the step is `hold` (n_x, n_x), s. The stage's input is `driven`
    (n_x,), 1/s.
    """

    A: FloatArray
    Q: FloatArray
    hold: FloatArray
    driven: FloatArray


def along(
    plant: Plant, a: LearningArrays, shift: Sequence[Stage], dt_s: float, *, sweeps: bool
) -> Iterator[Along]:
    """Yield the steps of a shift.

    Args:
        plant: The model with its tolerances.
        a: Its parameters, or a selection of them.
        shift: Stages of constant heats; their lengths are rounded to whole steps.
        dt_s: Length of a step, s; longer than an estimator's.
        sweeps: Whether readings ripple as nuts pass; without, nuts are spread over their strokes.
    """
    n_x, s = len(plant.decay_1_s), plant.rows.sensors
    first = n_x + int(plant.estimated.sum())
    x, law_W = _settled(plant, shift[0]), None
    last = np.tile(plant.rows.C[:s] @ x + plant.rows.F[:s] @ shift[0].z, (2, 1))
    F, H = np.eye(first + len(a.kind)) * np.exp(-dt_s / WANDER_S), np.zeros((s, first + len(a.kind)))
    nowhere = plant
    for stage in shift:
        plant = standing(nowhere, _standing_m(nowhere, stage))
        H[:, :n_x] = plant.rows.C[:s]
        step = _step(plant, stage, dt_s)
        F[:first, :first] = step.A
        jump_W = (stage.law_W - (stage.law_W if law_W is None else law_W))[plant.estimated]
        law_W = stage.law_W
        passing = _passing(plant, a, stage, H.shape[1]) if sweeps else np.zeros((1, *H.shape))
        for _ in range(round(stage.duration_s / dt_s)):
            drives = a.drives(x, plant.B, stage.law_W, stage.heat_W, stage.z)
            F[:n_x, first : first + a.machine] = step.hold @ drives[:, : a.machine]
            x = step.A[:n_x, :n_x] @ x + step.hold @ step.driven
            last = _see(plant, a, stage, x, last, dt_s, H)
            yield Along(plant, stage, x, F, step.Q, jump_W, H, passing)
            jump_W = np.zeros_like(jump_W)


def _settled(plant: Plant, stage: Stage) -> FloatArray:
    """Return the states of a screw at the air's temperature, its lags settled at their laws."""
    return np.asarray(plant.uniform * stage.z[plant.known.ambient] + stage.heat_W @ plant.lags)


def _standing_m(plant: Plant, stage: Stage) -> dict[int, float]:
    """Return the positions of standing nuts in m by their source's number."""
    nuts = zip(plant.moving, stage.sweeps, strict=True)
    return {nut.index: sweep.middle_m for nut, sweep in nuts if sweep is not None and sweep.speed_m_s == 0.0}


def _step(plant: Plant, stage: Stage, dt_s: float) -> _StageStep:
    """Return the step within a stage, by repeated doubling of a short part."""
    n_x = len(plant.decay_1_s)
    A_1_s = generator(plant, stage.loss_1_s)
    fastest_1_s = max(float(np.abs(A_1_s).sum(axis=1).max()), 1e-12)
    halves = max(0, int(np.ceil(np.log2(fastest_1_s * dt_s / _LONGEST))))
    part_s = dt_s / 2**halves
    A, Q = augmented_step(plant, part_s, stage.loss_1_s)
    hold = expm(np.block([[A_1_s, np.eye(n_x)], [np.zeros((n_x, 2 * n_x))]]) * part_s)[:n_x, n_x:]
    for _ in range(halves):
        Q = A @ Q @ A.T + Q
        hold = hold + A[:n_x, :n_x] @ hold
        A = A @ A
    driven = plant.B @ stage.heat_W + plant.E @ stage.z
    drawn_K_s = stage.loss_1_s * stage.drawn_degC
    return _StageStep(A, Q, hold, driven + drawn_K_s * (on_the_screw(plant) @ plant.uniform))


def _see(
    plant: Plant, a: LearningArrays, stage: Stage, x: FloatArray, last: FloatArray, dt_s: float, H: FloatArray
) -> FloatArray:
    """Write the effects of each sensor's offset, position, gain and lag at x into its row of H.

    Return the current readings (2, s) without lag and with the lag of one tolerance, from the `last` ones.
    """
    s, first = plant.rows.sensors, H.shape[1] - len(a.kind)
    now = plant.rows.C[:s] @ x + plant.rows.F[:s] @ stage.z
    slow = now.copy()
    sensor_parameters, lag = np.arange(a.machine, len(a.kind)), np.flatnonzero(a.lag_s)
    H[a.of[sensor_parameters], first + sensor_parameters] = a.entries(x, stage.z)[sensor_parameters]
    i, lag_s = a.of[lag], a.lag_s[lag]
    fade = np.exp(-dt_s / lag_s)
    mean = lag_s / dt_s * (1.0 - fade)
    slow[i] = fade * last[1, i] + (mean - fade) * last[0, i] + (1.0 - mean) * now[i]
    H[i, first + lag] += (slow[i] - now[i]) / lag_s
    return np.array([now, slow])


def _passing(plant: Plant, a: LearningArrays, stage: Stage, n: int) -> FloatArray:
    """Return the ripple of readings as nuts pass, by phases of a sweep, (f, s, n).

    Its columns are those of heats, laws, positions and lags. Without a sweeping nut it is one phase of zeros.
    """
    n_x, estimated, s = len(plant.decay_1_s), np.flatnonzero(plant.estimated).tolist(), plant.rows.sensors
    first, N = n_x + len(estimated), plant.modes
    rows, lag_s, slope_C = np.zeros((SWEEP_PHASES, s, n)), np.zeros(s), np.zeros((s, N))
    lag_s[a.of[a.kind == Nuisance.LAG]] = a.lag_s[a.kind == Nuisance.LAG]
    decay_1_s, C, slopes = plant.decay_1_s, plant.rows.C[:s], a.row
    if plant.basis is not None:
        decay_1_s, C, slopes = plant.basis.decay_1_s, C @ plant.basis.inverse, slopes @ plant.basis.inverse
    slope_C[a.of[a.kind == Nuisance.PLACE]] = slopes[a.kind == Nuisance.PLACE, :N]
    for nut, sweep in zip(plant.moving, stage.sweeps, strict=True):
        if sweep is None or sweep.speed_m_s == 0.0 or nut.index not in estimated:
            continue
        ripple_rows = ripple(nut.table, sweep, decay_1_s[:N], C[:, :N], slope_C, lag_s)
        rows[:, :, n_x + estimated.index(nut.index)] = ripple_rows.reading
        for q, (kind, of) in enumerate(zip(a.kind, a.of, strict=True)):
            if kind == Nuisance.LAW and estimated[of] == nut.index:
                rows[:, :, first + q] = ripple_rows.reading * stage.law_W[nut.index]
            elif kind in (Nuisance.PLACE, Nuisance.LAG):
                by = ripple_rows.by_place if kind == Nuisance.PLACE else ripple_rows.by_lag
                rows[:, of, first + q] += by[:, of] * stage.heat_W[nut.index]
    return rows if rows.any() else rows[:1]
