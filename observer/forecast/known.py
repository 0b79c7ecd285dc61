"""The excess of friction at the start of work, as found by a calibration: the prior of the rivals.

For a source, `run_in` is the excess over its law at a start, as a fraction of it. It fades with the time
constant `run_in_s`, and `run_in_tolerance` is the difference between starts.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from observer.config.machine import Config
from observer.estimators.kalman import KalmanEstimator
from observer.estimators.protocol import EstimatorState
from observer.frames import FloatArray, Inputs
from observer.model.plant import Plant

UNKNOWN_S = 1800.0
"""The time constant of a heat of which nothing was found, beside others of which it was."""


class KnownRunIn(NamedTuple):
    """The excess of each estimated heat at the start of work.

    Attributes:
        share: Excess as a fraction of the law, (m_e,).
        sigma: Its σ, (m_e,).
        time_s: Time constant with which it fades, s, (m_e,).
    """

    share: FloatArray
    sigma: FloatArray
    time_s: FloatArray

    def after(self, ran_s: float) -> KnownRunIn:
        """Return the excess at a start after the machine has run before.

        It lies evenly distributed between the full and the faded one: the mean is in the middle, and σ grows
        by 1/√12 of the range.

        Args:
            ran_s: Earlier running time, s.
        """
        faded = 1.0 - np.exp(-ran_s / self.time_s)
        sigma = np.hypot(self.sigma, self.share * faded / np.sqrt(12.0))
        return self._replace(share=self.share * (1.0 - 0.5 * faded), sigma=sigma)

    def slower(self, times: float) -> KnownRunIn:
        """Return the same with all time constants multiplied by `times`."""
        return self._replace(time_s=self.time_s * times)


def known_run_in(config: Config, plant: Plant, unknown: float) -> KnownRunIn | None:
    """Return the run-in that a configuration gives.

    Args:
        config: The machine.
        plant: Its model, for the order of the estimated heats.
        unknown: σ of the excess of heats without a known one, relative to the law.

    Returns:
        The run-in, or None if no estimated source has one.
    """
    source_by_name = {s.name: s for s in config.source}
    free = [source_by_name[plant.source_names[j]] for j in np.flatnonzero(plant.estimated)]
    if all(s.run_in is None for s in free):
        return None
    columns = zip(
        *((s.run_in or 0.0, s.run_in_tolerance or unknown, s.run_in_s or UNKNOWN_S) for s in free),
        strict=True,
    )
    return KnownRunIn(*map(np.array, columns))


def run_from_starts(one: KalmanEstimator, plant: Plant, inputs: Inputs, run_in: KnownRunIn) -> EstimatorState:
    """Run a filter over inputs whose laws jump where work begins and where its level changes.

    At each jump every heat gets its known excess, faded by the time since the first jump.

    Args:
        one: The filter.
        plant: Its model.
        inputs: Inputs with at least one jump.
        run_in: The excess.

    Returns:
        The state after the last step.
    """
    free = plant.estimated
    law_W, state, at, before_W = inputs.law_W[:, free], one.initial(), 0, np.zeros(int(free.sum()))
    rows = np.flatnonzero(inputs.law_jump_W.any(axis=1)).tolist()
    n_x = len(plant.decay_1_s)
    for row, end in zip(rows, [*rows[1:], len(inputs)], strict=True):
        if row > at:
            state, _ = one.run(state, inputs.part(at, row))
        level_W = law_W[row:end].mean(axis=0)
        faded = np.exp(-(inputs.time_s[row] - inputs.time_s[rows[0]]) / run_in.time_s)
        x = state.x_hat.copy()
        x[n_x : n_x + len(level_W)] += run_in.share * faded * (level_W - before_W)
        state, at, before_W = replace(state, x_hat=x), row, level_W
    return one.run(state, inputs.part(at, len(inputs)))[0]
