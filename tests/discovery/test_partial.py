"""What is reported of an unknown: the effect that explains most, if it explains anything for sure."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import pytest

from observer.discovery.candidates import library
from observer.discovery.search import FittedCandidate, Search
from observer.discovery.verdict import partial_of, proposable
from observer.fit.hypothesis import Fit, fit_effects, fit_null
from tests.discovery.small import problem_of
from tests.logs.machines import machine
from tests.logs.simulated import made_log


@cache
def null() -> Fit:
    """Of a machine one of whose sensors reads 0.5 K too much."""
    config = machine()
    bias = {"effect": [{"kind": "sensor_bias", "target": "a", "offset_K": 0.5}]}
    return fit_null(problem_of(config, [made_log(machine(**bias), 1)]), config)


@cache
def trial(name: str) -> FittedCandidate:
    """An effect fitted beside it."""
    base = null()
    config = base.problem.config
    candidate = next(c for c in library(config, base.problem.keys) if c.name == name)
    added = config.model_copy(update={"effect": (candidate.effect(candidate.shapes[0]),)})
    fit = fit_effects(base.problem, added, candidate.parameters(0))
    return FittedCandidate(candidate, fit, base.deviance - fit.deviance, 30.0, 0.5)


def reported(*ranking: FittedCandidate) -> str | None:
    partial = partial_of(Search(null(), null(), (), (), ranking, ()))
    return None if partial is None else partial.trial.candidate.name


def test_what_explains_most_is_reported() -> None:
    assert reported(trial("sensor_bias at a"), trial("sensor_drift at a")) == "sensor_bias at a"
    assert reported() is None


def test_a_strength_that_may_be_nothing_is_not_reported() -> None:
    """The interval of an offset of the sensor without one holds zero."""
    right = trial("sensor_bias at a")
    weak = replace(trial("sensor_bias at c"), drop=2.0 * right.drop)
    assert not weak.significant
    assert reported(weak, right) == "sensor_bias at a"


@pytest.mark.parametrize(("bore_m", "proposed"), [(0.0, "sensor_bias at a"), (0.004, "coolant")])
def test_coolant_is_proposed_for_a_hollow_screw_only(bore_m: float, proposed: str) -> None:
    bias, coolant = trial("sensor_bias at a"), trial("coolant")
    config = null().problem.config
    hollow = config.model_copy(update={"screw": config.screw.model_copy(update={"bore_m": bore_m})})
    problem = replace(null().problem, config=hollow)
    ranking = [
        replace(t, fit=replace(t.fit, problem=problem), drop=drop)
        for t, drop in ((coolant, 9e9), (bias, 1.0))
    ]
    search = Search(replace(null(), problem=problem), null(), (), (), tuple(ranking), ())
    assert next(t.candidate.name for t in proposable(search)) == proposed
