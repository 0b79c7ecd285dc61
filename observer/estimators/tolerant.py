"""Open-loop prediction by a machine that differs from its configuration within tolerances only.

Each heat follows its law times a scale. Sensors only identify the parameters θ of the machine within the
tolerances. The open-loop residual is therefore beyond the tolerances. The method is an extended Kalman filter
over [x | θ] (Jazwinski 1970, ch. 8) without noise on x; θ wanders about zero. The effects of θ are those of
`learning`, linearised at the prediction.
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
"""Time constant of the parameters within their tolerances.

A shorter one, such as the filter's day, would explain a change overnight as a change of parameters.
"""
LAW_FOLLOWS_S = 3600.0
"""Time constant of the fast part of a law's scale, such as run-in or warming grease."""
LAW_SHARE = 0.3
"""The fast part as a share of the law's uncertainty."""
MODEL_K, MODEL_SHARE = 0.1, 0.03
"""σ of the model at a sensor: a constant in K, and a share of the sensor's rise above the air."""
SAME_S = 8 * 3600.0
"""Correlation time of that error: readings within it count as one."""
FURTHEST = 3.5
"""Largest parameter in standard deviations."""
LEAST_FILM = -0.9
MOST_DEGRADED = 0.1
"""Largest share of a step with a missing or held input; beyond it the step has no prediction."""
_SURE = 3.0


class TolerantState(NamedTuple):
    """State of the prediction.

    Attributes:
        x: States of the plant, (n_x,).
        theta: Parameters, relative or in their units, 0 as configured, (t,).
        P: Joint covariance of [x | θ], (n, n).
    """

    x: FloatArray
    theta: FloatArray
    P: FloatArray


class ModelGap(NamedTuple):
    """The open-loop residual of a step, by sensor; NaN for displacements and without a reading.

    Attributes:
        gap_K: Measured minus predicted mean over the step, K, (s,).
        allowed_K: Its σ within tolerances, noise and the model's own error, K, (s,).
        rise_K: Predicted rise of each thermocouple above the air, K, (s,).
    """

    gap_K: FloatArray
    allowed_K: FloatArray
    rise_K: FloatArray


def _parameters(plant: Plant) -> LearningArrays:
    """Return the parameters: the machine's tolerances, then each law's scale and its fast part.

    Lags are omitted, because they are short relative to steps of a minute.
    """
    nuisance, estimated = plant.parameters, np.flatnonzero(plant.estimated)
    n_x, p = len(plant.decay_1_s), len(plant.known_names)
    tolerances = np.flatnonzero(np.isin(nuisance.kind, (Nuisance.LAW, Nuisance.LAG), invert=True))
    laws = [
        Parameter(Nuisance.LAW, j, share * sigma, no_change(n_x, p)._replace(law=int(index)))
        for share in (1.0, LAW_SHARE)
        for j, (index, sigma) in enumerate(zip(estimated, plant.law_uncertainty, strict=True))
    ]
    return joined(of_parameters(nuisance, tolerances), learning_of(laws, (), n_x, p).arrays)


class Tolerant:
    """The prediction of a plant by its laws within its tolerances; stateless.

    Args:
        plant: The model with its parameters (`build_plant` with `learns`). Lags of sensors are omitted.
    """

    def __init__(self, plant: Plant) -> None:
        self._plant = plant
        self._theta = _parameters(plant)
        self._at = {kind: np.flatnonzero(self._theta.kind == kind) for kind in Nuisance}
        self._fade_1_s = np.full(len(self._theta.kind), 1.0 / STAYS_S)
        self._fade_1_s[len(self._fade_1_s) - int(plant.estimated.sum()) :] = 1.0 / LAW_FOLLOWS_S
        self._slack = np.eye(len(plant.decay_1_s)) if plant.coupling.active else None

    def parameters(self, kind: Nuisance) -> NDArray[np.int64]:
        """Return the indices in θ of the parameters of a kind."""
        return self._at[kind]

    def initial(self) -> TolerantState:
        """Return the state before the first reading: θ = 0 with its configured σ.

        The field is 0 °C without uncertainty until `begin` sets it.
        """
        n_x, sigma = len(self._plant.decay_1_s), self._theta.sigma
        P = np.zeros((n_x + len(sigma), n_x + len(sigma)))
        P[n_x:, n_x:] = np.diag(sigma**2)
        return TolerantState(np.zeros(n_x), np.zeros(len(sigma)), P)

    def begin(self, state: TolerantState, u: Inputs) -> TolerantState:
        """Start the field from the readings at the end of a step, with the current parameters.

        A machine at rest that agrees with the air's temperature starts with a uniform temperature, σ
        `REST_K`. Otherwise the field starts at the mean of the readings, with the prior enlarged to their
        range.

        Args:
            state: Its parameters and their covariance stay; field and cross-covariances are replaced.
            u: One step.

        Returns:
            The state, corrected by the readings.
        """
        plant, n_x, s = self._plant, len(state.x), self._plant.rows.sensors
        used = u.usable[0] & np.isfinite(u.y_degC[0]) & plant.thermal
        y_degC, air_degC = u.y_degC[0][used], float(u.z_end[0, plant.known.ambient])
        P = np.zeros_like(state.P)
        P[n_x:, n_x:] = state.P[n_x:, n_x:]
        if self._is_at_rest(state, u):
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
        return self._learnt(state, self._reading_rows(u, x), gap_K, plant.noise_R_K2 + MODEL_K**2)

    def _is_at_rest(self, state: TolerantState, u: Inputs) -> bool:
        """Return whether no law makes heat and all sensors but one agree with the air's temperature.

        A single faulty sensor must not shape the field.
        """
        theta, P = self._theta, state.P[len(state.x) :, len(state.x) :]
        air = self.parameters(Nuisance.AMBIENT)
        shows = self._plant.rows.C[: self._plant.rows.sensors] @ self._plant.uniform > 0.5
        used = np.flatnonzero(u.usable[0] & self._plant.thermal & shows)
        if not self._theta.rests or u.law_W.any() or not len(air) or not len(used):
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
        return int(agree[used].sum()) >= max(1, len(used) - (len(used) > 2))

    def ahead(self, state: TolerantState, u: Inputs, *, learn: bool = True) -> tuple[TolerantState, ModelGap]:
        """Take one step by the laws.

        A reading weighs as one per `SAME_S`, because the model's error stays for hours. Parameters are
        limited to 3.5 σ.

        Args:
            state: The state before the step.
            u: One step with mean inputs and readings (`gathered`).
            learn: Whether the readings correct the state; without, it is an open loop.

        Returns:
            The state after the step, and the residual before the correction.
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
        H = self._reading_rows(u, x)
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
        predicted = 0.5 * (before[:s] + after[:s]) + self._of_sensors(x, u) @ theta
        return np.where(u.usable[0] & self._plant.thermal, u.y_degC[0] - predicted, np.nan)

    def _of_sensors(self, x: FloatArray, u: Inputs) -> FloatArray:
        """Return the effects of the sensors' parameters on readings at the end of a step, (s, t)."""
        t = self._theta
        rows = np.zeros((self._plant.rows.sensors, len(t.kind)))
        sensor_parameters = np.concatenate([self.parameters(kind) for kind in Nuisance if kind.of_a_sensor])
        rows[t.of[sensor_parameters], sensor_parameters] = t.entries(x, u.z_end[0])[sensor_parameters]
        return rows

    def _reading_rows(self, u: Inputs, x: FloatArray) -> FloatArray:
        """Return the derivatives of readings by [x | θ], (s, n)."""
        C = columns_in_place(self._plant, u, 0)[1]
        return np.hstack([C[: self._plant.rows.sensors], self._of_sensors(x, u)])

    def _drives(self, u: Inputs, x: FloatArray) -> FloatArray:
        """Return the effect of each parameter on dx/dt at a state, (n_x, t)."""
        B = columns_in_place(self._plant, u, 0)[0]
        return self._theta.drives(x, B, u.law_W[0], u.law_W[0], 0.5 * (u.z_start[0] + u.z_end[0]))

    def _forward(self, x: FloatArray, after: FloatArray, u: Inputs) -> FloatArray:
        """Return the derivative of the plant's step by x; by differences where states are coupled."""
        if self._slack is None:
            return np.diag(np.exp(-self._plant.decay_1_s * u.dt_s[0]))
        moved = [simulate(self._plant, x + one, u)[0] - after for one in self._slack]
        return np.column_stack(moved)

    def _learnt(self, state: TolerantState, H: FloatArray, gap_K: FloatArray, R: FloatArray) -> TolerantState:
        """Return the state after a correction, with parameters clipped to `FURTHEST`."""
        used = np.flatnonzero(np.isfinite(gap_K))
        if not len(used):
            return state
        H, n_x = H[used], len(state.x)
        (step, P), *_ = correct(Belief(np.zeros(len(state.P)), state.P), H, gap_K[used], np.diag(R[used]))
        edge = FURTHEST * self._theta.sigma
        least = np.where(self._theta.kind == Nuisance.CONVECTION, np.maximum(-edge, LEAST_FILM), -edge)
        theta = np.clip(state.theta + step[n_x:], least, edge)
        return TolerantState(state.x + step[:n_x], theta, 0.5 * (P + P.T))


def gathered(blocks: list[Inputs]) -> Inputs:
    """Return consecutive steps as one step with their means.

    Readings are means of the usable ones. Laws and columns of moving sources are averaged over time. Known
    inputs keep the first and the last value. `degraded` is 1 if more than a tenth of the steps are degraded.

    Args:
        blocks: Inputs of the same plant, in order.
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
