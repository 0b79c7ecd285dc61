"""The Kalman filter on filterpy's dense matrices: slow, to compare the compiled one with.

The matrices are those of the `specification`; prediction and correction are filterpy's. Start, gate,
learning and qualities are the kernels run as Python.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from filterpy.kalman import KalmanFilter

from observer.estimators.by_block import BlockEstimator, Scratch
from observer.estimators.packing import Results
from observer.estimators.specification import Columns, transition
from observer.estimators.steps import Chunk
from observer.frames import Inputs
from observer.kernels import advance, judging, learning
from observer.kernels import step as steps


class FilterpyEstimator(BlockEstimator):
    """Kalman filter by `filterpy.kalman.KalmanFilter`: joint corrections in Joseph's form, with the same
    rules.

    It neither screens readings nor gives bounds. A step costs dense products of n by n matrices in Python.
    Use it to check results of `KalmanEstimator`.
    """

    def take(self, chunk: Chunk, _inputs: Any, scratch: Scratch, out: Results, _results: Any) -> None:
        """Take a chunk's steps by filterpy; arguments as in `BlockEstimator.take`."""
        n = len(scratch.running.x)
        kf = KalmanFilter(dim_x=n, dim_z=max(self._plant.rows.sensors, 1))
        for k in range(len(chunk.step)):
            if self._predict(kf, chunk, k, scratch, out):
                self._correct(kf, chunk.inputs, k, scratch, out)
                self._write(chunk.inputs, k, scratch, out)

    def _predict(self, kf: Any, chunk: Chunk, k: int, scratch: Scratch, out: Results) -> bool:
        """Start, or predict; return whether the step could be taken."""
        p, u, work, state = self._arrays, chunk.inputs, scratch.work, scratch.running
        present = judging.find_usable(u, k, work.usable)
        if not judging.step_is_finite(u, k) or (state.flags[0] == 0 and present == 0):
            judging.skip(u, k, work.usable, state, out)
            return False
        advance.move_columns(p, u, k, work.B, work.C)
        if state.flags[0] == 0:
            steps.start(p, u, k, state, work)
            learning.begin(p, u, k, state, work)
            advance.put_laws(p, u, k, work.B, state.x, work.law)
            state.flags[0] = 1
            return True
        learning.follow(p, chunk, k, state.around, state.x, work)
        m_e, n_x, n = len(p.source), len(p.uniform), len(state.x)
        G = work.G[m_e : m_e + p.learn.machine, :n_x].T
        step = transition(self._plant, u, k, state.x, Columns(work.B.T, G))
        work.law[:] = step.law_W
        kf.x, kf.P = state.x[:, None].copy(), state.P[:, :n].copy()
        kf.predict(u=step.forced[:, None], B=np.eye(n), F=step.F, Q=step.Q)
        state.x[:], state.P[:, :n] = kf.x[:, 0], kf.P
        judging.inflate_for_lost_position(p, u, k, state.lost_s, state.P)
        return True

    def _correct(self, kf: Any, u: Inputs, k: int, scratch: Scratch, out: Results) -> None:
        """Correct by the sensors that pass the gate."""
        p, work, state = self._arrays, scratch.work, scratch.running
        n, s = len(state.x), len(p.R_K2)
        out.log_likelihood[k] = np.nan
        steps.compare(p, u, k, state, work)
        judging.write_innovations(work.nu, work.S_nu, work.usable, k, out)
        work.accepted[:] = False
        if work.usable.any():
            judging.judge_sensors(p, u, k, self.gate_sigma, state, work)
        if work.accepted.any():
            good = work.accepted
            H = np.zeros((s, n))
            H[:, : work.C.shape[1]] = work.C
            y = u.y_degC[k] - p.F @ u.z_end[k]
            learning.keep(p, state.x, state.P, work.saved)
            kf.x, kf.P = state.x[:, None].copy(), state.P[:, :n].copy()
            kf.update(y[good, None], R=np.diag(p.R_K2[good]), H=H[good])
            state.x[:], state.P[:, :n] = kf.x[:, 0], kf.P
            learning.give_back(p, state.x, state.P, work.saved)
        learning.draw_near(p, u.dt_s[k], state.x, state.around)

    def _write(self, u: Inputs, k: int, scratch: Scratch, out: Results) -> None:
        """Write step k."""
        p, work, state = self._arrays, scratch.work, scratch.running
        is_valid = judging.write_step(p, u, k, state, work, out)
        learning.report_learned(p, state.x, state.P, k, work, out)
        if not is_valid:
            judging.invalidate(out, k)
