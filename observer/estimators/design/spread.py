"""How sure an estimator will be over a shift, and what each tolerance has in that: covariances alone.

The filter of [x | δ | θ] (`model.learning`) is run without measurements on full matrices, for what is read
does not change a σ. Its steps are longer than the estimator's, with the noise that is left in the mean of as
many samples, which may be less than one. Nuts sweep over their strokes within a step: what rises and falls as
they pass (`cycle.ripple`) goes by phases. The effects of what is only roughly known are taken along the
field that the shift makes.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy.linalg import expm

from observer.estimators.design.gains import LuenbergerGain, Refusal, everything
from observer.estimators.design.steady import gain_for, standing
from observer.frames import FloatArray
from observer.kernels.codes import STILL
from observer.model.cycle import SWEEP_PHASES, Stage, ripple
from observer.model.discretise import step_matrices
from observer.model.generator import augmented_step, generator, on_the_screw
from observer.model.learning import WANDER_S, LearningArrays, Nuisance
from observer.model.plant import Plant
from observer.model.rod.supports import fold
from observer.tables.estimator import EstimatorSettings

FROM_S = 600.0
"""σ are means from ten minutes on: before that the heats are being found."""
EVERY = 3
"""Every which step takes part in the means."""
STEPS_S = (10.0, 20.0, 30.0)
"""Steps to choose from: the first that costs no more than `MOST_WORK`."""
MOST_WORK = 3e9
"""States cubed times steps times cases: a second or two."""
_TOO_MUCH_WORK = 4.0 * MOST_WORK
_LONGEST = 16.0  # a step in the plant's shortest time, beyond which its exponential is made of halves


class Spread(NamedTuple):
    """Mean σ of several cases over a shift: of each estimated heat (v, m_e), W; of the field (v,), K; of the
    thermal error (v,), µm, None without an expansion coefficient. The last two are means over the places.
    """

    heat_W: FloatArray
    field_K: FloatArray
    error_um: FloatArray | None


class Moment(NamedTuple):
    """A moment of a shift: the `plant` with its nuts where they stand, the `stage`, the states `x` (n_x,); by
    phases of a sweep, readings by the states, `H` (f, s, n); and the covariances `P` (v, n, n) about then.
    """

    plant: Plant
    stage: Stage
    x: FloatArray
    H: FloatArray
    P: FloatArray


class _StageStep(NamedTuple):
    """A step of [x | δ] within a stage: transition `A` and noise `Q` (n, n); `hold` (n_x, n_x), s, what an
    input held over it leaves; `driven` (n_x,), 1/s, that of the stage.
    """

    A: FloatArray
    Q: FloatArray
    hold: FloatArray
    driven: FloatArray


def spread(
    plant: Plant, settings: EstimatorSettings, shift: Sequence[Stage], cases: FloatArray
) -> Spread | None:
    """Return the σ over a shift for cases (v, L) of how much is left of each tolerance of the plant.

    The plant is one that knows its tolerances (`build_plant` with `learns`). None where the settings have no
    gain, or where there are so many states that it would take long.
    """
    a = plant.parameters
    dt_s = _step_s(plant, sum(stage.duration_s for stage in shift), len(cases))
    if dt_s is None:
        return None
    coarse = replace(plant, noise_R_K2=plant.noise_R_K2 * settings.period_s / dt_s)
    K = _fixed_gain(coarse, settings, dt_s)
    return None if isinstance(K, Refusal) else _over(coarse, a, shift, cases * a.sigma, K, dt_s)


def _step_s(plant: Plant, duration_s: float, cases: int) -> float | None:
    """The shortest step that is little work, or the longest while that is bearable; None where it is not."""
    n = len(plant.decay_1_s) + int(plant.estimated.sum()) + plant.learnt
    work_s = n**3 * cases * duration_s
    fitting = [step_s for step_s in STEPS_S if work_s / step_s <= MOST_WORK]
    if not fitting and work_s / STEPS_S[-1] > _TOO_MUCH_WORK:
        return None
    return (*fitting, STEPS_S[-1])[0]


def _fixed_gain(plant: Plant, settings: EstimatorSettings, dt_s: float) -> FloatArray | Refusal | None:
    """The gain (n, s) of an observer that has one for all steps, None for a Kalman filter."""
    if settings.kind != "luenberger" and settings.engine != "constant":
        return None
    gain = gain_for(plant, step_matrices(plant, dt_s), everything(plant), settings)
    return gain.K if isinstance(gain, LuenbergerGain) else gain


def _over(
    plant: Plant,
    a: LearningArrays,
    shift: Sequence[Stage],
    sigma: FloatArray,
    K: FloatArray | None,
    dt_s: float,
) -> Spread:
    """The mean σ with tolerances `sigma` (v, L)."""
    found = [_sigmas(each, a) for each in moments(plant, a, shift, sigma, K, dt_s)]
    heat, field, error = (np.mean(column, axis=0) for column in zip(*found, strict=True))
    there = len(plant.rows.C) > plant.rows.error_slice.start
    return Spread(heat, field.mean(axis=1), error.mean(axis=1) if there else None)


def moments(
    plant: Plant,
    a: LearningArrays,
    shift: Sequence[Stage],
    sigma: FloatArray,
    K: FloatArray | None,
    dt_s: float,
    weight_1_K: FloatArray | None = None,
) -> Iterator[Moment]:
    """Yield moments of a shift from `FROM_S` on, each `EVERY` steps `dt_s`, with tolerances `sigma` (v, L).

    The gain is `K`, or the Kalman filter's. `weight_1_K` (v, s) is one over each reading's own σ in
    each case, 0 for a reading that is not used.
    """
    n_x, m_e, L, s = len(plant.decay_1_s), int(plant.estimated.sum()), len(a.kind), plant.rows.sensors
    first = n_x + m_e
    P, x, law_W = _start(plant, a, shift[0], sigma, at_rest=K is None), _settled(plant, shift[0]), None
    last = np.tile(plant.rows.C[:s] @ x + plant.rows.F[:s] @ shift[0].z, (2, 1))
    fade, t_s, count = np.exp(-dt_s / WANDER_S), 0.0, 0
    F, H = np.eye(first + L) * fade, np.zeros((s, first + L))
    Q = np.zeros((len(sigma), first + L, first + L))
    Q[:, range(first, first + L), range(first, first + L)] = sigma**2 * (1.0 - fade**2)
    nowhere = plant
    for stage in shift:
        plant = standing(nowhere, _standing_m(nowhere, stage))
        H[:, :n_x] = plant.rows.C[:s]
        step = _step(plant, stage, dt_s)
        F[:first, :first], Q[:, :first, :first] = step.A, step.Q
        jump_W = (stage.law_W - (stage.law_W if law_W is None else law_W))[plant.estimated]
        P[:, range(n_x, first), range(n_x, first)] += (plant.law_uncertainty * jump_W) ** 2
        law_W = stage.law_W
        passing = _passing(plant, a, stage, first + L) if K is None else np.zeros((1, *H.shape))
        noise_R = np.tile(plant.noise_R_K2 * len(passing), len(passing))
        for _ in range(round(stage.duration_s / dt_s)):
            drives = a.drives(x, plant.B, stage.law_W, stage.heat_W, stage.z)
            F[:n_x, first : first + a.machine] = step.hold @ drives[:, : a.machine]
            x = step.A[:n_x, :n_x] @ x + step.hold @ step.driven
            last = _see(plant, a, stage, x, last, dt_s, H)
            seen = H + passing
            before = F @ P @ F.T + Q
            if weight_1_K is None:
                P = _corrected(before, seen.reshape(-1, first + L), noise_R, K, a, first)
            else:  # rows in standard deviations: a reading that is not used is a row of nothing
                rows = weight_1_K[:, None, :, None] * seen / np.sqrt(len(seen))
                rows = rows.reshape(len(sigma), -1, first + L)
                P = _corrected(before, rows, np.ones(rows.shape[1]), None, a, first)
            t_s, count = t_s + dt_s, count + 1
            if (
                t_s >= FROM_S and count % EVERY == 0
            ):  # samples come all through the step: their P lies between those at its end
                yield Moment(plant, stage, x, seen, 0.5 * (before + P))


def _settled(plant: Plant, stage: Stage) -> FloatArray:
    """The screw at the air's temperature, its lags settled at their laws."""
    return np.asarray(plant.uniform * stage.z[plant.known.ambient] + stage.heat_W @ plant.lags)


def _standing_m(plant: Plant, stage: Stage) -> dict[int, float]:
    """Where nuts stand, by their source's number; the others are spread over their strokes."""
    nuts = zip(plant.moving, stage.sweeps, strict=True)
    return {nut.index: sweep.middle_m for nut, sweep in nuts if sweep is not None and sweep.speed_m_s == 0.0}


def _start(plant: Plant, a: LearningArrays, stage: Stage, sigma: FloatArray, *, at_rest: bool) -> FloatArray:
    """The covariances (v, n, n) before the first correction; `at_rest`: rest is taken for rest."""
    n_x, m_e = len(plant.decay_1_s), int(plant.estimated.sum())
    first = n_x + m_e
    P = np.zeros((len(sigma), first + len(a.kind), first + len(a.kind)))
    rest = (
        at_rest
        and a.rests == 1
        and {Nuisance.AMBIENT, Nuisance.OFFSET} <= set(a.kind)
        and not stage.law_W.any()
    )
    P[:, :n_x, :n_x] = a.rest_P if rest else plant.prior_P
    still = STILL if rest else 1.0
    P[:, range(n_x, first), range(n_x, first)] = (still * plant.initial_sigma_W) ** 2
    own = range(first, first + len(a.kind))
    P[:, own, own] = sigma**2
    for i in np.flatnonzero(a.kind == Nuisance.AMBIENT) if rest else ():
        together = sigma[:, i, None] ** 2 * plant.uniform
        P[:, :n_x, first + i] = P[:, first + i, :n_x] = together
        P[:, :n_x, :n_x] += together[:, :, None] * plant.uniform
    return P


def _step(plant: Plant, stage: Stage, dt_s: float) -> _StageStep:
    """The step within a stage: of a short enough part, and then twice as long again and again."""
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
    """Put what offset, place and lag of each sensor do to its reading at x into its row of H; return what
    sensors read now with no lag and with one of the whole tolerance, (2, s), from what they read before.
    """
    s, first = plant.rows.sensors, H.shape[1] - len(a.kind)
    now = plant.rows.C[:s] @ x + plant.rows.F[:s] @ stage.z
    slow = now.copy()
    own, lag = np.arange(a.machine, len(a.kind)), np.flatnonzero(a.lag_s)
    H[a.of[own], first + own] = a.entries(x)[own]
    i, lag_s = a.of[lag], a.lag_s[lag]
    fade = np.exp(-dt_s / lag_s)
    mean = lag_s / dt_s * (1.0 - fade)
    slow[i] = fade * last[1, i] + (mean - fade) * last[0, i] + (1.0 - mean) * now[i]
    H[i, first + lag] += (slow[i] - now[i]) / lag_s
    return np.array([now, slow])


def _passing(plant: Plant, a: LearningArrays, stage: Stage, n: int) -> FloatArray:
    """What sensors see of the nuts that pass, on top of the mean, by phases of a sweep, (f, s, n): of heats,
    laws, places and lags; one phase of nothing where no nut does.
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
        own = ripple(nut.table, sweep, decay_1_s[:N], C[:, :N], slope_C, lag_s)
        rows[:, :, n_x + estimated.index(nut.index)] = own.seen
        for q, (kind, of) in enumerate(zip(a.kind, a.of, strict=True)):
            if kind == Nuisance.LAW and estimated[of] == nut.index:
                rows[:, :, first + q] = own.seen * stage.law_W[nut.index]
            elif kind in (Nuisance.PLACE, Nuisance.LAG):
                by = own.by_place if kind == Nuisance.PLACE else own.by_lag
                rows[:, of, first + q] += by[:, of] * stage.heat_W[nut.index]
    return rows if rows.any() else rows[:1]


def _corrected(
    P: FloatArray, H: FloatArray, R_K2: FloatArray, K: FloatArray | None, a: LearningArrays, first: int
) -> FloatArray:
    """The covariances after a correction by all sensors: by K, which knows of no parameter, or by the Kalman
    gain, which leaves the parameters that are considered only as they are (Schmidt 1966). H is (r, n), or
    (v, r, n) where each case has its own.
    """
    if K is not None:
        left = np.eye(P.shape[1])
        left[:first] -= K @ H
        P = left @ P @ left.T
        P[:, :first, :first] += (K * R_K2) @ K.T
        return P
    PH = P @ H.swapaxes(-1, -2)
    learned = PH @ np.linalg.solve(H @ PH + np.diag(R_K2), PH.swapaxes(1, 2))
    held = first + a.held
    learned[:, held[:, None], held] = 0.0
    P = P - learned
    return np.asarray(0.5 * (P + P.swapaxes(1, 2)))


def _sigmas(now: Moment, a: LearningArrays) -> tuple[FloatArray, FloatArray, FloatArray]:
    """σ of heats (v, m_e), field (v, g) and thermal error (v, g or 0)."""
    plant, stage, x, P = now.plant, now.stage, now.x, now.P
    n_x, estimated, g = len(x), np.flatnonzero(plant.estimated), plant.rows.grid
    heats = np.eye(len(estimated), P.shape[1], n_x)
    for q in np.flatnonzero(a.kind == Nuisance.LAW):
        heats[a.of[q], n_x + len(estimated) + q] = stage.law_W[estimated[a.of[q]]]
    rows = plant.rows.C[plant.rows.sensors :]
    heat = np.sqrt(((heats @ P) * heats).sum(axis=2))
    variance = ((rows @ P[:, :n_x, :n_x]) * rows).sum(axis=2)
    wide = np.sqrt(np.maximum(variance, 0.0))
    value = np.tile(rows @ x + plant.rows.F[plant.rows.sensors :] @ stage.z, (len(P), 1))
    _, error = fold(plant.rows.restraint, value[:, g:], wide[:, g:])
    return heat, wide[:, :g], error
