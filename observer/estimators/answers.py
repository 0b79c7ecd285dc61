"""Whether readings answer the heats: a sensor that repeats one value stays still while the screw does not.

Each minute a prediction begins from the estimate. It continues for ten minutes by laws and air, without
readings. A reading does not answer if it stays constant within its noise while its prediction moves clearly.
No quality is good until it answers. A sensor that stays constant while others answer is at fault. The test
needs a recent change of a law: a machine at rest gives no verdict. It also gives none where heats rest on
their laws and a prediction moves by less than their uncertainty.
"""

from __future__ import annotations

from typing import NamedTuple, Self

import numpy as np

from observer.frames import BoolArray, FloatArray
from observer.model.generator import generator
from observer.model.plant import Plant

PREDICTIONS = 10
"""How many predictions run on side by side."""
SETTLED_S = 1200.0
"""Time after a start during which misfits show errors of the model rather than of the sensors."""
_BEGIN_STEPS = 12  # of the bank, between the beginnings of two predictions
_SMOOTH_STEPS = 6.0  # over which readings and predictions are averaged alike
_SMOOTH_NOISE = 1.0 / np.sqrt(2.0 * _SMOOTH_STEPS - 1.0)  # what averaging leaves of the noise
_CONSTANT_SIGMA = 3.3  # standard deviations of averaged noise within which a reading is constant
_ASKED_K, _ASKED_TIMES = 0.7, 8.0  # least move of a prediction that calls for an answer, K and relative
_UNCERTAIN_SIGMA, _ALL_UNCERTAIN_SIGMA = 3.0, 2.0  # and beyond so many of its standard deviations
_SURE_TIMES = 2.0  # and so much farther proves which sensor is at fault
_ALL_ASKED, _ALL_CONSTANT = 0.3, 1.1  # of both, in the root mean square over all readings
_ANSWER_SHARE = 0.5  # of a prediction's way, what an answer shows
_ASKED_AFTER_S = 1800.0  # a change of a law
_PARTS = 256  # of a step of a response, which is right to 1e-4 for what settles within 20 s
_LAW_STEPS, _LAW_SIGMA = 12.0, 4.0  # averaged over, and standard deviations of its heat, a law has changed


class SensorAnswers(NamedTuple):
    """Movements of readings and of predictions since each prediction began.

    With s sensors, h heats and w = `PREDICTIONS` predictions. Readings and predictions are averaged over six
    steps of the bank. Methods change the arrays in place, NaN means unknown.

    Attributes:
        mean_degC: Averaged readings, °C, (s,).
        predicted_degC: Averaged predictions, °C, (w, s).
        first_degC: Averaged readings when each prediction began, °C, (w, s).
        first_predicted_degC: Predictions at their beginning, °C, (w, s).
        moved_K: Largest distance of each reading from its first value, K, (w, s).
        predicted_moved_K: Largest distance of each prediction from its first value, K, (w, s).
        silent: 1 for sensors that do not answer, (s,). The mark stays until the sensor answers.
        at_fault: 1 for sensors that are surely at fault, (s,).
        answering: 1 for sensors that answer, (s,).
        law_W: Averaged heats by their laws, W, (h,).
        first_law_W: Those laws when each prediction began, W, (w, h).
        first_sigma_W: σ of the heats when each prediction began, W, (w, h).
        since: Time since a law last changed, s, and the number of steps, (2,).
    """

    mean_degC: FloatArray
    predicted_degC: FloatArray
    first_degC: FloatArray
    first_predicted_degC: FloatArray
    moved_K: FloatArray
    predicted_moved_K: FloatArray
    silent: FloatArray
    at_fault: FloatArray
    answering: FloatArray
    law_W: FloatArray
    first_law_W: FloatArray
    first_sigma_W: FloatArray
    since: FloatArray

    @classmethod
    def empty(cls, sensors: int, heats: int) -> Self:
        """Return the answers before the first reading.

        Args:
            sensors: Number s of sensors.
            heats: Number h of estimated heats.

        Returns:
            Arrays of NaN without marks. The time since a change of a law is infinite, so `judge` gives no
            verdict.
        """
        unknown, zeros = np.full((PREDICTIONS, sensors), np.nan), np.zeros(sensors)
        return cls(
            np.full(sensors, np.nan), unknown, unknown.copy(), unknown.copy(), unknown.copy(), unknown.copy(),
            zeros, zeros.copy(), zeros.copy(), np.full(heats, np.nan), np.full((PREDICTIONS, heats), np.nan),
            np.full((PREDICTIONS, heats), np.nan), np.array([np.inf, 0.0]),
        )  # fmt: skip

    def begin_again(self) -> None:
        """Forget all predictions; sensors that did not answer still have to."""
        self.since[1] = 0.0
        for windows in (self.predicted_degC, self.moved_K, self.predicted_moved_K, self.first_law_W):
            windows[:] = np.nan

    def forget(self) -> None:
        """Forget all readings, predictions and marks."""
        self.begin_again()
        self.mean_degC[:] = self.law_W[:] = np.nan
        for mark in (self.silent, self.at_fault, self.answering):
            mark[:] = 0.0

    def note(self, read_degC: FloatArray, predicted_degC: FloatArray) -> int:
        """Record the readings and predictions of one step of the bank.

        Args:
            read_degC: Readings, °C, (s,), NaN without a new one.
            predicted_degC: Predictions of them, °C, (w, s). Those that have not begun yet are ignored.

        Returns:
            The number of the prediction that the caller starts again from the estimate, or -1. One prediction
            starts every twelve steps, a minute.
        """
        present = np.isfinite(read_degC)
        count = int(self.since[1])
        predicted_degC = np.where(
            count > _BEGIN_STEPS * np.arange(PREDICTIONS)[:, None], predicted_degC, np.nan
        )
        mean_degC = self.mean_degC + (read_degC - self.mean_degC) / _SMOOTH_STEPS
        np.copyto(self.mean_degC, np.where(np.isnan(mean_degC), read_degC, mean_degC), where=present)
        begins = present & np.isnan(self.predicted_degC) & np.isfinite(predicted_degC)
        predicted = self.predicted_degC + (predicted_degC - self.predicted_degC) / _SMOOTH_STEPS
        np.copyto(self.predicted_degC, np.where(begins, predicted_degC, predicted), where=present)
        np.copyto(self.first_degC, self.mean_degC, where=begins)
        np.copyto(self.first_predicted_degC, predicted_degC, where=begins)
        for moved_K, now, first in (
            (self.moved_K, self.mean_degC, self.first_degC),
            (self.predicted_moved_K, self.predicted_degC, self.first_predicted_degC),
        ):
            np.copyto(moved_K, 0.0, where=begins)
            np.copyto(moved_K, np.maximum(moved_K, np.abs(now - first)), where=present)
        self.since[1] += 1.0
        if count % _BEGIN_STEPS:
            return -1
        begun = count // _BEGIN_STEPS % PREDICTIONS
        self.predicted_degC[begun] = self.moved_K[begun] = self.predicted_moved_K[begun] = np.nan
        self.first_law_W[begun] = np.nan
        return begun

    def note_laws(self, law_W: FloatArray, sigma_W: FloatArray, span_s: float) -> None:
        """Record the heats by their laws over the last step of the bank.

        A law has changed if its mean differs from that at a prediction's beginning by more than four σ of its
        heat.

        Args:
            law_W: Heats by their laws, W, (h,).
            sigma_W: σ of the estimated heats, W, (h,).
            span_s: Length of the step, s.
        """
        mean_W = self.law_W + (law_W - self.law_W) / _LAW_STEPS
        self.law_W[:] = np.where(np.isfinite(mean_W), mean_W, law_W)
        begins = np.isnan(self.first_law_W)
        np.copyto(self.first_law_W, self.law_W, where=begins)
        np.copyto(self.first_sigma_W, sigma_W, where=begins)
        changed = np.any(np.abs(self.law_W - self.first_law_W) > _LAW_SIGMA * self.first_sigma_W)
        self.since[0] = 0.0 if changed else self.since[0] + span_s

    def judge(self, constant_K: FloatArray, threshold_K: FloatArray, response_K_W: FloatArray) -> None:
        """Mark the sensors that answer the laws, those that do not, and those that are surely at fault.

        No mark changes if no law has changed within half an hour. A sensor answers if it moves by half of the
        way of its prediction.

        Args:
            constant_K: Movement within which a reading counts as constant, K, (s,).
            threshold_K: Movement of a prediction beyond which its sensor must move too, K, (s,).
            response_K_W: Responses of readings to heats, K/W, (t, s, h), from `heat_response_K_W`. Zeros if
                heats are well known. Predictions within three of their σ require no answer.
        """
        if self.since[0] > _ASKED_AFTER_S:
            return
        self.answering[:] = self.at_fault[:] = 0.0
        moved_ratio = self.predicted_moved_K / threshold_K
        if not (moved_ratio > _ALL_ASKED).any():
            return
        still = self.moved_K / constant_K
        sigma_K = self._sigma_K(response_K_W)
        certain = self.predicted_moved_K > _UNCERTAIN_SIGMA * sigma_K
        constant = (moved_ratio > 1.0) & certain & (still < 1.0)
        answers = (moved_ratio > 1.0) & (self.moved_K > _ANSWER_SHARE * self.predicted_moved_K)
        unanswered: BoolArray = np.any(constant, axis=0)
        self.answering[:] = np.any(answers, axis=0) & ~unanswered
        if _none_answers(moved_ratio, sigma_K / threshold_K, still):
            unanswered[:] = True
        self.silent[:] = ((self.silent > 0.0) | unanswered) & (self.answering == 0.0)
        self.at_fault[:] = (constant & (moved_ratio > _SURE_TIMES)).any(axis=0)

    def _sigma_K(self, response_K_W: FloatArray) -> FloatArray:
        """Return the standard deviations (w, s) of predictions now, by the heats they began with, in K."""
        steps = (int(self.since[1]) - 1 - _BEGIN_STEPS * np.arange(PREDICTIONS)) % len(response_K_W)
        first_W = np.nan_to_num(self.first_sigma_W)
        return np.asarray(np.sqrt(np.einsum("wsh,wh->ws", response_K_W[steps] ** 2, first_W**2)))

    def sensor_at_fault(self, taken: BoolArray) -> int:
        """Return the sensor that alone does not answer while others do.

        Args:
            taken: True for sensors that the estimate uses, (s,).

        Returns:
            Its number. It is -1 if none or several sensors are silent, or if at most one other sensor
            answers.
        """
        sure = np.flatnonzero((self.at_fault > 0.0) & taken)
        is_unique = len(sure) == 1 and self.silent[taken].sum() == 1.0
        return int(sure[0]) if is_unique and self.answering[taken].sum() > 1.0 else -1


def answers_of(noise_K: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the two limits of movement that `SensorAnswers.judge` takes.

    Args:
        noise_K: σ of each sensor's noise, K, (s,).

    Returns:
        The largest movement of a constant reading and the smallest movement that requires an answer, K, both
        (s,). The first is 3.3 σ of the averaged noise. The second is eight times as large, at least 0.7 K.
    """
    constant_K = _CONSTANT_SIGMA * _SMOOTH_NOISE * noise_K
    return constant_K, np.maximum(_ASKED_K, _ASKED_TIMES * constant_K)


def heat_response_K_W(plant: Plant, step_s: float) -> FloatArray:
    """Return the response of each sensor to 1 W more of a heat at the beginning of a prediction.

    A moving nut is spread over its stroke. The heat returns to its law at the rate `plant.heat_decay_1_s`.
    The step is the 256th power of an implicit Euler step, accurate to 1e-4 for parts that settle within 20 s.

    Args:
        plant: The model; time-varying losses are left out.
        step_s: Time between two steps of a prediction, s.

    Returns:
        Temperature rises after 0, 1, … steps, K/W, (t, s, m_e), with t the number of steps that a prediction
        lasts.
    """
    A, B = generator(plant), plant.B[:, plant.estimated]
    n_x, m_e = B.shape
    both = np.zeros((n_x + m_e, n_x + m_e))
    both[:n_x, :n_x], both[:n_x, n_x:] = A, B
    both[n_x:, n_x:] = -np.diag(plant.heat_decay_1_s)
    # implicit, so that no rate is too fast; the daemon does without scipy's exponential
    part = np.linalg.inv(np.eye(n_x + m_e) - step_s / _PARTS * both)
    step, state = np.linalg.matrix_power(part, _PARTS), np.vstack([np.zeros((n_x, m_e)), np.eye(m_e)])
    response = np.empty((_BEGIN_STEPS * PREDICTIONS, plant.rows.sensors, m_e))
    for t in range(len(response)):
        response[t] = plant.rows.C[: plant.rows.sensors] @ state[:n_x]
        state = step @ state
    return response


def _none_answers(moved_ratio: FloatArray, sigma: FloatArray, still: FloatArray) -> bool:
    """Return whether, since some prediction began, all of several readings have been constant together.

    All are (w, s): how far predictions moved, their standard deviation, and how far readings moved.
    """
    present = np.isfinite(moved_ratio)
    count = present.sum(axis=1)
    moves, spread, stays = (np.where(present, a * a, 0.0).sum(axis=1) for a in (moved_ratio, sigma, still))
    asks = (moves > _ALL_ASKED**2 * count) & (moves > _ALL_UNCERTAIN_SIGMA**2 * spread)
    return bool(((count > 1) & (stays < _ALL_CONSTANT**2 * count) & asks).any())
