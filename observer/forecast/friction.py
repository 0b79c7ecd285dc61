"""Rival models of friction, as filters over the whole of a log, each weighted by its likelihood.

Heats that wander as freely as the configuration allows may be anything an hour later, and a short log then
says little about film and laws. Most friction wanders less: it is its law times a constant, with an excess at
the start of work that dies away. The rivals are this model with several time constants, and the heats as
configured. All of them learn every parameter that `[tolerance]` and the laws leave open. The weight of a
rival is its likelihood (Magill 1965) to a power (Holmes & Walker 2017). So a machine with other friction is
forecast with the configured heats.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any, get_args

import numpy as np

from observer.config.estimator import EstimatorSettings, Learnable
from observer.config.machine import Config
from observer.estimators import packing
from observer.estimators.kalman import KalmanEstimator
from observer.estimators.protocol import EstimatorState
from observer.estimators.steps import Chunk
from observer.forecast.ahead import CALM, Runner, runner, runner_by_law
from observer.forecast.known import KnownRunIn, known_run_in, run_from_starts
from observer.forecast.program import Program
from observer.frames import EstimateBlock, FloatArray, Inputs, Quality
from observer.model.build import build_plant
from observer.model.learning import WANDER_S, Nuisance
from observer.model.plant import Plant

RUNS_IN_S = (900.0, 1800.0, 3600.0)
"""Time constants with which friction may settle to its law, once running …"""
FINELY_S = (900.0, 1270.0, 1800.0, 2550.0, 3600.0)
"""… and those where a calibration has found the laws."""
TIMES = (0.7, 1.0, 1.4)
"""… and, where it has found how friction runs in, in parts of the time constants found."""
EXCESS_SIGMA = 0.15
"""One standard deviation of what it has more or less when work begins, in parts of its law."""
EACH_COUNTS = 0.5
"""The power, where a calibration has left the laws so well known that readings near each other share what no
rival describes: each counts as half a one.
"""
Way = Callable[[Plant, EstimatorSettings, EstimatorState, Program], Runner]
"""How it goes ahead from a state."""
LEAST_WEIGHT = 0.02
"""A rival that is less likely than this is left out."""
PAUSE_S, IDLE_W = 60.0, 1e-3
"""Work begins anew after so long without heat."""
MOST_S = 12.0 * 3600.0
"""What is longer ago is forgotten."""


class WeighedFilter(KalmanEstimator):
    """A filter that sums the log-likelihood of its accepted readings.

    Attributes:
        log_likelihood: The sum over all steps since the object was made.
    """

    log_likelihood = 0.0

    def take(self, chunk: Chunk, inputs: Any, scratch: Any, out: packing.Results, results: Any) -> None:
        """Take a chunk's steps, and add their log-likelihood; arguments as in `BlockEstimator.take`."""
        super().take(chunk, inputs, scratch, out, results)
        self.log_likelihood += float(np.nansum(out.log_likelihood))


class FrictionBank:
    """The rivals, over the inputs since the last start; they are run on request.

    Args:
        config: The machine. The rivals learn every parameter with a tolerance.
    """

    def __init__(self, config: Config) -> None:
        """Begin before the first step."""
        self._config = config
        self._parts: deque[Inputs] = deque()

    def take(self, inputs: Inputs, block: EstimateBlock) -> None:
        """Store some steps; inputs older than twelve hours are dropped.

        Args:
            inputs: The steps.
            block: Their estimates. Readings that these did not use are left out.
        """
        trusted = inputs.usable & (block.sensor_quality == int(Quality.GOOD))
        self._parts.append(inputs._replace(usable=trusted))
        while inputs.time_s[-1] - self._parts[0].time_s[-1] > MOST_S:
            self._parts.popleft()

    def begins(self, program: Program) -> list[tuple[float, Runner]]:
        """Run the rivals, and return a runner for each likely one with its weight, the likeliest first.

        Weights add up to 1. Rivals below `LEAST_WEIGHT` are left out.

        Args:
            program: The program, at one level.

        Raises:
            ValueError: If no rival has an estimate that can be used.
        """
        joined = Inputs.joined(list(self._parts))
        inputs = since_start(joined, float(program.past.dt_s.sum()))
        settings = self._config.estimator.model_copy(update={"learn": get_args(Learnable)})
        config = self._config.model_copy(update={"estimator": settings})
        plant, is_known = build_plant(config, learns=True), is_calibrated(config)
        lasting = build_plant(with_known_scales(config), learns=True) if is_known else plant
        wander_s, times_s = (WANDER_S / CALM**2, FINELY_S) if is_known else (WANDER_S, RUNS_IN_S)
        rivals: list[tuple[Way, Plant, KnownRunIn | None]] = [(runner, plant, None)]
        if (run_in := known_at_start(config, plant, joined, inputs)) is None:
            rivals += [(runner_by_law, running_in(lasting, time_s, wander_s), None) for time_s in times_s]
        else:
            slower = [run_in.slower(times) for times in TIMES]
            rivals += [(runner_by_law, running_in(lasting, k.time_s, wander_s, k.sigma), k) for k in slower]
        filters = [WeighedFilter(model, settings) for _, model, _ in rivals]
        states = [
            one.run(one.initial(), inputs)[0]
            if run_in is None
            else run_from_starts(one, model, inputs, run_in)
            for one, (_, model, run_in) in zip(filters, rivals, strict=True)
        ]
        power = EACH_COUNTS if is_known else 1.0
        weights = weights_of([power * one.log_likelihood for one in filters])
        weighed = [
            (float(weights[i]), way(model, settings, states[i], program))
            for i, (way, model, _) in enumerate(rivals)
            if weights[i] > 0.0
        ]
        return sorted(weighed, key=lambda one: -one[0])


def is_of_use(config: Config, program: Program) -> bool:
    """Return whether rivals apply: filters that learn, heats with laws, and work at one level.

    In a cycle friction behaves in another way at each start, which these rivals do not model.

    Args:
        config: The machine.
        program: The program.
    """
    has_laws = all(source.law is not None for source in config.source if source.estimate)
    return config.estimator.learns and has_laws and program.is_even


def since_start(inputs: Inputs, even_s: float) -> Inputs:
    """Return the inputs from the pause before the last start on, with jumps of the laws at two rows only.

    These are the start and the row where the current level began. At both the laws jump to their mean. Other
    jumps, as where a nut turns round, carry no information on friction.

    Args:
        inputs: All stored inputs, with work in some row.
        even_s: Time since the current level began, s.
    """
    working_rows = np.flatnonzero(np.abs(inputs.law_W).sum(axis=1) > IDLE_W)
    pauses = np.flatnonzero(np.diff(inputs.time_s[working_rows]) > PAUSE_S)
    begin, start = (
        (working_rows[pauses[-1]] + 1, working_rows[pauses[-1] + 1]) if len(pauses) else (0, working_rows[0])
    )
    level = max(int(np.searchsorted(inputs.time_s, inputs.time_s[-1] - even_s)), int(start))
    jumps = np.zeros_like(inputs.law_jump_W)
    jumps[[start, level]] = inputs.law_W[level:].mean(axis=0)
    return inputs._replace(law_jump_W=jumps).part(int(begin), len(inputs))


def known_at_start(config: Config, plant: Plant, inputs: Inputs, since: Inputs) -> KnownRunIn | None:
    """Return the known run-in at the last start.

    Args:
        config: The machine with its `run_in`.
        plant: Its model.
        inputs: All stored inputs.
        since: Those since the last start, as `since_start` returns them.

    Returns:
        The run-in after the earlier work. None if the configuration has none, or if the record begins during
        work.
    """
    run_in = known_run_in(config, plant, EXCESS_SIGMA)
    is_working = np.abs(inputs.law_W).sum(axis=1) > IDLE_W
    if run_in is None or is_working[0]:
        return None
    return run_in.after(float(inputs.dt_s[is_working & (inputs.time_s < since.time_s[0])].sum()))


def weights_of(log_likelihoods: Sequence[float]) -> FloatArray:
    """Return the probability of each rival, which add up to 1.

    The first has the same prior as all others together. Those below `LEAST_WEIGHT` become 0.

    Args:
        log_likelihoods: Log-likelihood of each rival, two or more.
    """
    count = len(log_likelihoods)
    prior = np.array([0.5, *[0.5 / (count - 1)] * (count - 1)])
    logs = np.array(log_likelihoods) + np.log(prior)
    weights = np.exp(logs - logs.max())
    weights[weights < LEAST_WEIGHT * weights.sum()] = 0.0
    return np.asarray(weights / weights.sum())


def is_calibrated(config: Config) -> bool:
    """Return whether a calibration has written the remaining uncertainty of the scale of some law."""
    return any(s.scale_tolerance is not None for s in config.source)


def with_known_scales(config: Config) -> Config:
    """Return the configuration with `scale_tolerance` as the uncertainty of a law, where calibration set
    one.
    """
    sources = (
        s if s.scale_tolerance is None else s.model_copy(update={"law_uncertainty": s.scale_tolerance})
        for s in config.source
    )
    return config.model_copy(update={"source": tuple(sources)})


def running_in(
    plant: Plant, time_s: float | FloatArray, wander_s: float, excess: float | FloatArray = EXCESS_SIGMA
) -> Plant:
    """Return a plant whose heats by law are the law times a learnt constant, plus an excess that dies away.

    The excess begins anew whenever the law jumps. Heats without a law stay unchanged.

    Args:
        plant: The model with its tolerances.
        time_s: Time constant with which the excess fades, s, one or (m_e,).
        wander_s: Time constant of the learnt parameters, s. A scale that wanders by a twenty-fifth in half an
            hour would imitate run-in.
        excess: σ of the excess, relative to the law, one or (m_e,).
    """
    assert plant.learning is not None
    arrays = plant.learning.arrays
    by_law = np.isin(np.arange(len(plant.law_uncertainty)), arrays.of[arrays.kind == Nuisance.LAW])
    return replace(
        plant,
        random_walk_W2_s=np.where(by_law, 0.0, plant.random_walk_W2_s),
        heat_decay_1_s=np.where(by_law, 1.0 / time_s, plant.heat_decay_1_s),
        law_uncertainty=np.where(by_law, excess, plant.law_uncertainty),
        learning=replace(plant.learning, wander_s=wander_s),
        initial_sigma_W=np.where(by_law, 1e-3, plant.initial_sigma_W),
    )
