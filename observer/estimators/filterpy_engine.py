"""The Kalman filter on filterpy's dense matrices: engine "filterpy", and the compiled engine's oracle."""

from __future__ import annotations

from typing import Any

import numpy as np

from observer.estimators.by_block import BlockEstimator
from observer.estimators.compiled import judging, kernels
from observer.estimators.compiled.packing import Results, Running, Work
from observer.estimators.compiled.steps import Chunk
from observer.frames import FloatArray, Inputs
from observer.model import advance
from observer.model.coupling import coupled
from observer.model.discretise import StepMatrices


class FilterpyEstimator(BlockEstimator):
    """Kalman filter by `filterpy.kalman.KalmanFilter`: joint corrections, Joseph form, the same rules."""

    def _take(self, chunk: Chunk, running: Running, out: Results, work: Work) -> None:
        from filterpy.kalman import KalmanFilter  # noqa: PLC0415  (slow to import)

        kf = KalmanFilter(dim_x=len(running.x), dim_z=max(self._plant.rows.sensors, 1))
        for k, length in enumerate(chunk.step):
            kf.x, kf.P = running.x[:, None].copy(), running.P[:, : len(running.x)].copy()
            step, _ = self._steps.get(chunk.lengths_s[length])
            self._step(kf, chunk.inputs, k, step, running, out, work)

    def _step(
        self, kf: Any, u: Inputs, k: int, step: StepMatrices, running: Running, out: Results, work: Work
    ) -> None:
        plant, s = self._plant, self._plant.rows.sensors
        usable = u.usable[k] & np.isfinite(u.y_degC[k])
        ready = bool(judging.step_is_finite(u, k))
        if not ready or not (running.flags[0] or usable.any()):
            judging.skip(u, k, usable, running, out)
            return
        B, C = plant.B.T.copy(), plant.rows.C[:s].copy()
        advance.move_columns(self._arrays, u, k, B, C)
        if running.flags[0]:
            self._predict(kf, u, k, step, B, work)
            judging.doubt_nut(self._arrays, u, k, running.lost_s, kf.P)
        else:
            kernels.start(self._arrays, C, u, k, usable, running.x, running.P, work.nu)
            advance.put_laws(self._arrays, u, k, B, running.x, work.law)
            running.flags[0] = 1
            kf.x, kf.P = running.x[:, None].copy(), running.P[:, : len(running.x)].copy()
        H = np.hstack([C[:s], np.zeros((s, len(running.x) - C.shape[1]))])
        y = u.y_degC[k] - plant.rows.F[:s] @ u.z_end[k]
        nu = y - H @ kf.x[:, 0]
        S = np.diag(H @ kf.P @ H.T) + plant.noise_R_K2
        out.log_likelihood[k] = np.nan
        judging.write_innovations(nu, S, usable, k, out)
        accepted = np.zeros(s, dtype=np.bool_)
        if judging.gate(nu, S, usable, running.suspect, self._gate_sigma, accepted):
            judging.add_prior(self._arrays, kf.P, 1.0)
        else:
            judging.hold_back(nu, usable, accepted, running.suspect, running.refused_s, running.opened_K)
        judging.reopen(
            self._arrays, C, u.dt_s[k], usable, accepted, nu, running.refused_s, running.opened_K, kf.P
        )
        if accepted.any():
            kf.update(y[accepted, None], R=np.diag(plant.noise_R_K2[accepted]), H=H[accepted])
        running.x[:], running.P[:, : len(running.x)] = kf.x[:, 0], kf.P
        out.quality[k] = judging.judge(u, k, usable, accepted, running, out)
        judging.move_rows(self._arrays, u, k, work.rows)
        known = judging.write_values(self._arrays, u, k, running.x, work, out)
        known = judging.write_sigmas(running.P, out.heat_sigma, out.field_sigma, k, work) and known
        if not known:
            judging.invalidate(out, k)

    def _predict(self, kf: Any, u: Inputs, k: int, step: StepMatrices, B: FloatArray, work: Work) -> None:
        """Predict with the dense Ad and Qd of this step's columns."""
        plant = self._plant
        columns = B[plant.estimated]
        m_e, n_x = columns.shape
        Ad = np.diag(np.concatenate([step.decay, step.heat_decay]))
        Ad[:n_x, n_x:] = (columns * step.couple).T
        Qd = np.zeros_like(Ad)
        Qd[:n_x, :n_x] = plant.field_noise_Q * step.dt_s
        Qd[:n_x, :n_x] += np.einsum("ja,jb,jab->ab", columns, columns, step.walk_xx)
        Qd[n_x:, :n_x] = columns * step.walk_dx
        Qd[:n_x, n_x:] = Qd[n_x:, :n_x].T
        Qd[n_x:, n_x:] = np.diag(step.walk_dd)
        jump = plant.law_uncertainty * u.law_jump_W[k, plant.estimated]
        self._couple_half(kf, u, k, u.z_start[k], B, work)
        advance.put_laws(self._arrays, u, k, B, kf.x[:, 0], work.law)
        held = B.T @ work.law + plant.E @ u.z_start[k]
        known = step.hold * held + step.ramp * (plant.E @ (u.z_end[k] - u.z_start[k]))
        known = np.concatenate([known, np.zeros(m_e)])[:, None]
        kf.P[n_x:, n_x:] += np.diag(jump**2)
        kf.predict(u=known, B=np.eye(n_x + m_e), F=Ad, Q=Qd)
        self._couple_half(kf, u, k, u.z_end[k], B, work)

    def _couple_half(self, kf: Any, u: Inputs, k: int, z: FloatArray, B: FloatArray, work: Work) -> None:
        """Half a step of what couples the states, on the dense matrices."""
        coupling = self._plant.coupling
        if not coupling.active:
            return
        M, b, x = work.couple, work.shift, np.ascontiguousarray(kf.x[:, 0])
        coupled(coupling, u.loss_1_s[k], u.loss_degC[k], z, B, 0.5 * u.dt_s[k], x, M, b)
        n_x = len(b)
        whole = np.eye(len(x))
        whole[:n_x, :n_x] = M
        kf.x = whole @ x[:, None]
        kf.x[:n_x, 0] += b
        kf.P = whole @ kf.P @ whole.T
