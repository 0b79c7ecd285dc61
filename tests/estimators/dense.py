"""The whole history at once: the joint Gaussian of all states of a plant, on dense matrices."""

from dataclasses import replace

import numpy as np

from observer.estimators.specification import half_step
from observer.model.discretise import augmented, quantise, step_matrices
from observer.model.simulate import start


def start_mean(plant, u):
    """A screw of one temperature, the median of the first sensors, its lags at rest under their laws."""
    C, F, x = (
        plant.rows.C[: plant.rows.sensors],
        plant.rows.F[: plant.rows.sensors],
        start(plant, 0.0, u.law_W[0]),
    )
    levels = (u.y_degC[0] - C @ x - F @ u.z_end[0]) / (C @ plant.uniform)
    return x + plant.uniform * np.median(levels[u.usable[0]])


def posterior_heats(plant, u, used=None):
    """Mean and σ (K, m_e) of every heat and residuals (K, s) given all `used` measurements of `u`.

    The covariance form cov(δ, y) (cov(y) + R)⁻¹ needs no inverse of a state's covariance.
    """
    used = u.usable if used is None else used
    mean, covariance = _joint_prior(plant, u)
    n_x, n, s = len(plant.decay_1_s), mean.shape[1], plant.rows.sensors
    H = np.zeros((len(u), s, len(u), n))
    for k in range(len(u)):
        H[k, :, k, :n_x] = _moved(plant, u, k).rows.C[:s]
    H = H.reshape(len(u) * s, -1)[used.ravel()]
    R = np.broadcast_to(plant.noise_R_K2, (len(u), s))[used]
    y = (u.y_degC - u.z_end @ plant.rows.F[:s].T)[used]
    gain = np.linalg.solve(H @ covariance @ H.T + np.diag(R), H @ covariance).T
    all_states = mean.ravel() + gain @ (y - H @ mean.ravel())
    variance = np.diag(covariance - gain @ H @ covariance).reshape(len(u), n)
    residual = np.full((len(u), s), np.nan)
    residual[used] = y - H @ all_states
    delta = all_states.reshape(len(u), n)[:, n_x:]
    return u.law_W[:, plant.estimated] + delta, np.sqrt(variance[:, n_x:]), residual


def _joint_prior(plant, u):
    """Mean (K, n) and covariance (K n, K n) of the augmented states before any measurement."""
    K, n_x, m_e = len(u), len(plant.decay_1_s), int(plant.estimated.sum())
    n = n_x + m_e
    mean, cov = np.zeros((K, n)), np.zeros((K, n, K, n))
    mean[0, :n_x], nothing = start_mean(plant, u), np.zeros(n)
    cov[0, :n_x, 0, :n_x] = plant.prior_P
    cov[0, n_x:, 0, n_x:] = np.diag(plant.initial_sigma_W**2)
    for k in range(1, K):
        here = _moved(plant, u, k)
        step = step_matrices(here, float(quantise(u.dt_s[k])))
        F, Q = augmented(here, step)
        known = step.hold * (here.B @ u.law_W[k] + here.E @ u.z_start[k])
        known += step.ramp * (here.E @ (u.z_end[k] - u.z_start[k]))
        before, shift = half_step(here, u, k, u.z_start[k], here.B, nothing, n)
        after, shift_after = half_step(here, u, k, u.z_end[k], here.B, nothing, n)
        mean[k] = after @ (F @ (before @ mean[k - 1] + shift) + np.pad(known, (0, n - n_x))) + shift_after
        jump = np.zeros((n, n))
        jump[n_x:, n_x:] = np.diag((plant.jump_uncertainty * u.law_jump_W[k][plant.estimated]) ** 2)
        whole = after @ F @ before
        cov[k] = np.tensordot(whole, cov[k - 1], 1)
        cov[:, :, k] = np.moveaxis(cov[k], 0, -1)
        cov[k, :, k] = whole @ cov[k - 1, :, k - 1] @ whole.T + after @ (F @ jump @ F.T + Q) @ after.T
    return mean, cov.reshape(K * n, K * n)


def _moved(plant, u, k):
    """The plant with the columns of step k in place."""
    B, C = plant.B.copy(), plant.rows.C.copy()
    for i, source in enumerate(plant.moving):
        B[:, source.index] = u.moving_B[k, i]
        C[:, plant.modes + source.index] = u.moving_C[k, i]
    return replace(plant, B=B, rows=replace(plant.rows, C=C))
