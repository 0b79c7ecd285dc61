"""Open-loop prediction by a machine that may be off its configuration within tolerances, and no further.

No heat is free here: each follows its law, times a scale. The sensors only say which machine within the
tolerances this is, θ, so what is left between prediction and sensors is beyond them. An extended Kalman
filter over [x | θ] (Jazwinski 1970, ch. 8) without noise on x; θ wanders about nothing. What a θ does is that
of `learning`, taken at the prediction.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from observer.estimators.specification import Belief, columns_in_place, correct
from observer.frames import FloatArray, Inputs
from observer.model.learning import (
    LearningArrays,
    Nuisance,
    Parameter,
    joined,
    learning_of,
    no_change,
    of_parameters,
)
from observer.model.plant import Plant
from observer.model.rod.modes import held_s
from observer.model.simulate import simulate, start

STAYS_S = 100 * 86_400.0
"""For how long a machine stays the one it is within its tolerances. A filter forgets in a day, so that it is
never too sure; here what appears overnight would then be taken for another machine within them.
"""
LAW_FOLLOWS_S = 3600.0
"""In what time the fast part of a law's scale becomes another one: running in, grease that warms."""
LAW_SHARE = 0.3
"""That part, of what is not known of the law."""
MODEL_K, MODEL_SHARE = 0.1, 0.03
"""How far a model may be off at a sensor in any case, and with the sensor's rise above the air besides …"""
SAME_S = 8 * 3600.0
"""… which stays the same for so long: readings meanwhile say no more than one."""
FURTHEST = 3.5
"""Nothing is taken to be further off than so many standard deviations."""
LEAST_FILM = -0.9
MOST_DEGRADED = 0.1
"""An input that was missing or held for so much of a step leaves that step without a prediction."""
_SURE = 3.0


class TolerantState(NamedTuple):
    """Where the prediction stands: `x` (n_x,), `theta` (t,), and their joint covariance `P` (n, n)."""

    x: FloatArray
    theta: FloatArray
    P: FloatArray


class ModelGap(NamedTuple):
    """What a step leaves: measured minus predicted `gap_K` (s,), NaN where nothing was measured; the standard
    deviation `allowed_K` (s,) that it may have, and how much warmer than the air each is predicted.
    """

    gap_K: FloatArray
    allowed_K: FloatArray
    rise_K: FloatArray


def _parameters(plant: Plant) -> LearningArrays:
    """What the machine may be within: its own tolerances, then those of its laws, whole and the fast part; a
    lag is nothing beside steps of a minute.
    """
    known, estimated = plant.parameters, np.flatnonzero(plant.estimated)
    n_x, p = len(plant.decay_1_s), len(plant.known_names)
    own = np.flatnonzero(np.isin(known.kind, (Nuisance.LAW, Nuisance.LAG), invert=True))
    laws = [
        Parameter(Nuisance.LAW, j, share * sigma, no_change(n_x, p)._replace(law=int(index)))
        for share in (1.0, LAW_SHARE)
        for j, (index, sigma) in enumerate(zip(estimated, plant.law_uncertainty, strict=True))
    ]
    return joined(of_parameters(known, own), learning_of(laws, (), n_x, p).arrays)


class Tolerant:
    """The prediction of a plant that was built with what is learnt of it; holds no state of its own."""

    def __init__(self, plant: Plant) -> None:
        self._plant = plant
        self._theta = _parameters(plant)
        self._at = {kind: np.flatnonzero(self._theta.kind == kind) for kind in Nuisance}
        self._fade_1_s = np.full(len(self._theta.kind), 1.0 / STAYS_S)
        self._fade_1_s[len(self._fade_1_s) - int(plant.estimated.sum()) :] = 1.0 / LAW_FOLLOWS_S
        self._slack = np.eye(len(plant.decay_1_s)) if plant.coupling.active else None

    def parameters(self, kind: Nuisance) -> NDArray[np.int64]:
        """Return which entries of θ are of a kind."""
        return self._at[kind]

    def initial(self) -> TolerantState:
        """Return the state of a machine of which nothing has been seen."""
        n_x, sigma = len(self._plant.decay_1_s), self._theta.sigma
        P = np.zeros((n_x + len(sigma), n_x + len(sigma)))
        P[n_x:, n_x:] = np.diag(sigma**2)
        return TolerantState(np.zeros(n_x), np.zeros(len(sigma)), P)

    def begin(self, state: TolerantState, u: Inputs) -> TolerantState:
        """Begin where the sensors say at the end of a step `u`, with what is known of the machine by now.

        A machine that stands, and is as warm as the air as far as is known, has one temperature.
        """
        plant, n_x, s = self._plant, len(state.x), self._plant.rows.sensors
        seen = u.usable[0] & np.isfinite(u.y_degC[0]) & plant.thermal
        y_degC, air_degC = u.y_degC[0][seen], float(u.z_end[0, plant.known.ambient])
        P = np.zeros_like(state.P)
        P[n_x:, n_x:] = state.P[n_x:, n_x:]
        if self._stands(state, u):
            x = start(plant, air_degC, u.law_W[0])
            P[:n_x, :n_x] = self._theta.rest_P
            of_air = np.flatnonzero(self._theta.kind == Nuisance.AMBIENT)
            F = np.eye(len(P))
            F[:n_x, n_x + of_air] = plant.uniform[:, None]
            x, P = x + plant.uniform * state.theta[of_air].sum(), F @ P @ F.T
        else:
            x = start(plant, float(np.mean(y_degC)) if len(y_degC) else air_degC, u.law_W[0])
            spread_K = float(np.ptp(y_degC)) if len(y_degC) else 0.0
            C = plant.rows.C[:s]
            largest_K2 = float(np.max(np.einsum("ia,ab,ib->i", C, plant.prior_P, C)))
            P[:n_x, :n_x] = max(1.0, spread_K**2 / largest_K2) * plant.prior_P
        state = TolerantState(x, state.theta, P)
        rows = columns_in_place(plant, u, 0)[1] @ x + plant.rows.F @ u.z_end[0]
        gap_K = self._gap(u, rows, rows, x, state.theta)
        return self._learnt(state, self._seen(u, x), gap_K, plant.noise_R_K2 + MODEL_K**2)

    def _stands(self, state: TolerantState, u: Inputs) -> bool:
        """Whether no law makes heat, and all sensors but one show the air's temperature, as far as is known:
        one that has gone wrong must not turn into a field.
        """
        theta, P = self._theta, state.P[len(state.x) :, len(state.x) :]
        air = self.parameters(Nuisance.AMBIENT)
        shows = self._plant.rows.C[: self._plant.rows.sensors] @ self._plant.uniform > 0.5
        seen = np.flatnonzero(u.usable[0] & self._plant.thermal & shows)
        if not self._theta.rests or u.law_W.any() or not len(air) or not len(seen):
            return False
        offset_K = (
            self._of_sensors(state.x, u)[:, self.parameters(Nuisance.OFFSET)]
            @ state.theta[self.parameters(Nuisance.OFFSET)]
        )
        offset_K2 = np.zeros(len(offset_K))
        offset_K2[theta.of[self.parameters(Nuisance.OFFSET)]] = (
            theta.sigma[self.parameters(Nuisance.OFFSET)] ** 2
        )
        K2 = offset_K2 + P[np.ix_(air, air)].sum() + self._plant.noise_R_K2
        air_degC = u.z_end[0, self._theta.ambient] + state.theta[air].sum()
        agree = (u.y_degC[0] - offset_K - air_degC) ** 2 <= _SURE**2 * K2
        return int(agree[seen].sum()) >= max(1, len(seen) - (len(seen) > 2))

    def ahead(self, state: TolerantState, u: Inputs, *, learn: bool = True) -> tuple[TolerantState, ModelGap]:
        """One step, of which `u` holds the means: the state, and what it leaves.

        Without `learn` the readings say nothing of the machine.
        """
        plant, theta = self._plant, self._theta
        dt_s, n_x = float(u.dt_s[0]), len(state.x)
        C = columns_in_place(plant, u, 0)[1]
        before = C @ state.x + plant.rows.F @ u.z_start[0]
        after, rows = simulate(plant, state.x, u)
        hold = held_s(plant.decay_1_s, dt_s)
        middle = 0.5 * (state.x + after)
        A, c = theta.feedback(state.theta), self._drives(u, middle)
        x = after + hold * (c @ state.theta)
        fade = np.exp(-dt_s * self._fade_1_s)
        F = np.zeros_like(state.P)
        F[:n_x, :n_x] = self._forward(state.x, after, u) + hold[:, None] * A
        F[:n_x, n_x:] = hold[:, None] * c
        F[n_x:, n_x:] = np.diag(fade)
        Q = np.diag(np.concatenate([np.zeros(n_x), theta.sigma**2 * (1 - fade**2)]))
        now = TolerantState(x, fade * state.theta, F @ state.P @ F.T + Q)
        H = self._seen(u, x)
        shift = rows[0] + C @ (x - after)
        gap_K = self._gap(u, before, shift, x, now.theta)
        rise_K = shift[: plant.rows.sensors] - np.where(plant.thermal, u.z_end[0, plant.known.ambient], 0.0)
        R = plant.noise_R_K2 + MODEL_K**2 + (MODEL_SHARE * rise_K) ** 2
        allowed_K = np.sqrt(np.einsum("ia,ab,ib->i", H, now.P, H) + R)
        gap = ModelGap(gap_K, allowed_K, rise_K)
        return (self._learnt(now, H, gap_K, R * max(1.0, SAME_S / dt_s)) if learn else now), gap

    def _gap(
        self, u: Inputs, before: FloatArray, after: FloatArray, x: FloatArray, theta: FloatArray
    ) -> FloatArray:
        s = self._plant.rows.sensors
        said = 0.5 * (before[:s] + after[:s]) + self._of_sensors(x, u) @ theta
        return np.where(u.usable[0] & self._plant.thermal, u.y_degC[0] - said, np.nan)

    def _of_sensors(self, x: FloatArray, u: Inputs) -> FloatArray:
        """What the parameters of sensors add to readings at the end of a step, (s, t)."""
        t = self._theta
        rows = np.zeros((self._plant.rows.sensors, len(t.kind)))
        own = np.concatenate([self.parameters(kind) for kind in Nuisance if kind.of_a_sensor])
        rows[t.of[own], own] = t.entries(x, u.z_end[0])[own]
        return rows

    def _seen(self, u: Inputs, x: FloatArray) -> FloatArray:
        """The readings' derivatives by [x | θ], (s, n)."""
        C = columns_in_place(self._plant, u, 0)[1]
        return np.hstack([C[: self._plant.rows.sensors], self._of_sensors(x, u)])

    def _drives(self, u: Inputs, x: FloatArray) -> FloatArray:
        """What each parameter adds to dx/dt at a state, c (n_x, t)."""
        B = columns_in_place(self._plant, u, 0)[0]
        return self._theta.drives(x, B, u.law_W[0], u.law_W[0], 0.5 * (u.z_start[0] + u.z_end[0]))

    def _forward(self, x: FloatArray, after: FloatArray, u: Inputs) -> FloatArray:
        """The plant's own step, ∂x'/∂x; by differences where states are coupled."""
        if self._slack is None:
            return np.diag(np.exp(-self._plant.decay_1_s * u.dt_s[0]))
        moved = [simulate(self._plant, x + one, u)[0] - after for one in self._slack]
        return np.column_stack(moved)

    def _learnt(self, state: TolerantState, H: FloatArray, gap_K: FloatArray, R: FloatArray) -> TolerantState:
        """The state after its readings; a parameter goes to the edge of its tolerance and no further."""
        seen = np.flatnonzero(np.isfinite(gap_K))
        if not len(seen):
            return state
        H, n_x = H[seen], len(state.x)
        (step, P), *_ = correct(Belief(np.zeros(len(state.P)), state.P), H, gap_K[seen], np.diag(R[seen]))
        edge = FURTHEST * self._theta.sigma
        least = np.where(self._theta.kind == Nuisance.CONVECTION, np.maximum(-edge, LEAST_FILM), -edge)
        theta = np.clip(state.theta + step[n_x:], least, edge)
        return TolerantState(state.x + step[:n_x], theta, 0.5 * (P + P.T))


def gathered(blocks: list[Inputs]) -> Inputs:
    """Return consecutive steps as one, of their means; readings that cannot be used are left out.

    A moving source's columns count as its heat did.
    """
    u = Inputs.joined(blocks)
    dt = np.maximum(u.dt_s, 1e-9)
    share = dt / dt.sum()
    usable = u.usable & np.isfinite(u.y_degC)
    count = usable.sum(axis=0)
    y = np.where(usable, u.y_degC, 0.0).sum(axis=0) / np.maximum(count, 1)
    loss = share * u.loss_1_s
    last = u.part(len(u) - 1)
    total = loss.sum()
    return last._replace(
        dt_s=np.array([u.dt_s.sum()]),
        y_degC=y[None],
        degraded=np.array([np.mean(u.degraded > 0) > MOST_DEGRADED], dtype=np.int8),
        usable=(count > 0)[None],
        law_W=(share @ u.law_W)[None],
        z_start=u.z_start[:1],
        moving_B=_mean_of_columns(u.moving_B, share),
        moving_C=_mean_of_columns(u.moving_C, share),
        loss_1_s=np.array([total]),
        loss_degC=np.array([loss @ u.loss_degC / total if total > 0.0 else 0.0]),
    )


def _mean_of_columns(columns: FloatArray, share: FloatArray) -> FloatArray:
    return np.asarray(np.einsum("k,kmn->mn", share, columns)[None])
