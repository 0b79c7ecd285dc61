"""Luenberger and constant gains."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np

from observer.config.estimator import EstimatorSettings
from observer.estimators.design.gains import everything
from observer.estimators.design.steady import steady_covariance
from observer.estimators.fixed_gain import ConstantGainEstimator, LuenbergerEstimator
from observer.model.discretise import step_matrices
from tests.bits.digests import estimated, given
from tests.bits.shared import (
    COUPLINGS,
    Arrays,
    Cases,
    coupled,
    lose,
    off_for_long,
)
from tests.logs.inputs import driven
from tests.logs.plants import described, rod, small
from tests.logs.rounding import firm

CASES = Cases()
case, cases_of = CASES.case, CASES.cases_of


def steady(estimator, plant, *blocks, state=None) -> Arrays:
    """A run by fixed gains; what they are goes into what is given, for LAPACK finds them."""
    state, estimates = state or estimator.initial(), []
    begun = state
    for u in blocks:
        state, block = estimator.run(state, u)
        estimates.append(block)
    cut = replace(plant, learning=None)
    K = estimator.gain(step_matrices(cut, 0.5), everything(cut))
    return {"given": given(plant, blocks, K, begun.P)} | estimated(state, *estimates)


def at_steady_state(estimator, plant, u, period_s=0.5):
    """The state after the first step, with the covariance that it would have after very many."""
    cut = replace(plant, learning=None)
    step = step_matrices(cut, period_s)
    steady = steady_covariance(cut, step, estimator.gain(step, everything(cut)))
    assert steady is not None
    state, _ = estimator.run(estimator.initial(), u.part(0, 1))
    P, n = state.P.copy(), len(steady.P)
    P[:n, :n] = 0.5 * (steady.P + steady.P.T)
    P[:n, n:] = P[n:, :n] = 0.0
    verdict = state.verdict.copy()
    verdict["runs_s"] = 1e9  # a constant gain has long taken over
    return replace(state, P=P, verdict=verdict, gain_sensors=(1 << plant.rows.sensors) - 1)


def settled_run(estimator, plant, u, *, ends=()) -> Arrays:
    """A run from the steady state on, in blocks that end at some steps."""
    state, ends = at_steady_state(estimator, plant, u), [1, *ends, len(u)]
    parts = [u.part(a, b) for a, b in itertools.pairwise(ends)]
    return steady(estimator, plant, *parts, state=state)


def fixed(plant, kind, **settings):
    settings = {"bandwidth_1_s": 0.005} | settings
    if kind == "luenberger":
        return LuenbergerEstimator(plant, EstimatorSettings(kind=kind, **settings))
    return ConstantGainEstimator(plant, EstimatorSettings(engine=kind, **settings))


BOTH = {"constant": {"kind": "constant"}, "luenberger": {"kind": "luenberger"}}


def _even(plant, steps):
    """Steps of the period with every sensor, no law that jumps."""
    u = driven(plant, steps)
    u.law_W[:], u.law_jump_W[:] = 9.0, 0.0
    return u


@cases_of(**BOTH)
def settled(kind):
    """It leaves the steady state for a while in every way there is."""
    plant = firm(small(walk_W_sqrt_s=3.0))
    u = _even(plant, 160)
    lose(u, 10, 1)
    u.usable[20, 1] = False
    u.dt_s[30], u.dt_s[40] = 0.6, 1.0
    u.law_jump_W[50, 2], u.law_jump_W[55, 1], u.law_jump_W[58, 2] = 100.0, 100.0, 0.1
    u.degraded[60] = 2
    u.degraded[65] = 1
    u.law_W[70, 1] = np.nan
    u.z_end[75, 0] = np.inf
    u.y_degC[85, 1] += 1e6
    lose(u, slice(100, 106), slice(None))
    lose(u, slice(115, 117), 0)
    lose(u, slice(120, 140), 2)
    u.y_degC[145:149] += 80.0
    return settled_run(fixed(plant, kind, gate_sigma=30.0), plant, u, ends=(80, 81))


@cases_of(**BOTH)
def settled_without_two_of_its_sensors(kind):
    """The steady state of the sensors that are left, at another length of step."""
    plant = firm(rod(modes=2, walk_W_sqrt_s=3.0, sources_m=(0.3,)))
    u = _even(plant, 60)
    lose(u, slice(2, 60), slice(0, 2))
    u.dt_s[20:] = 1.0
    found = settled_run(fixed(plant, kind, gate_sigma=1e6), plant, u)
    # covariances of 1e-24 are what LAPACK leaves of nothing, in bits of its own on every computer
    return found | {"state.P": firm(found["state.P"])}


@cases_of(**BOTH)
def settled_with_a_nut(kind):
    plant = firm(small((1,), walk_W_sqrt_s=3.0, grid=9))
    return settled_run(fixed(plant, kind, gate_sigma=1e9), plant, _even(plant, 40))


@cases_of(**BOTH)
def settled_of_one_sensor_and_one_heat(kind):
    plant = firm(rod((0.1,), (0.0,), modes=2, grid=2, walk_W_sqrt_s=3.0))
    return settled_run(fixed(plant, kind, gate_sigma=1e9), plant, _even(plant, 40))


@cases_of(**BOTH)
def settled_of_eight_modes(kind):
    plant = firm(rod(modes=8, walk_W_sqrt_s=3.0))
    return settled_run(fixed(plant, kind, gate_sigma=1e9), plant, _even(plant, 40))


@case
def settled_of_forty_modes_and_eight_sensors():
    places = (0.03, 0.1, 0.17, 0.25, 0.33, 0.4, 0.48, 0.57)
    plant = firm(rod(places, modes=40, grid=21, walk_W_sqrt_s=3.0))
    u = _even(plant, 14)
    lose(u, 8, 1)
    return settled_run(fixed(plant, "constant", gate_sigma=1e9), plant, u)


@cases_of(**BOTH)
def settled_that_overflows(kind):
    plant = firm(small(walk_W_sqrt_s=3.0))
    estimator, u = fixed(plant, kind, gate_sigma=1e9), _even(plant, 4)
    state = at_steady_state(estimator, plant, u)
    state.x_hat[-1] = np.inf
    return steady(estimator, plant, u.part(1), state=state)


@cases_of(**BOTH)
def fixed_gain_that_overflows(kind):
    """Far from the steady state."""
    plant = firm(small(walk_W_sqrt_s=3.0))
    estimator, u = fixed(plant, kind, gate_sigma=1e9), _even(plant, 4)
    state, _ = estimator.run(estimator.initial(), u.part(0, 1))
    state.x_hat[-1] = np.inf
    return steady(estimator, plant, u.part(1), state=state)


@cases_of(**BOTH)
def fixed_gain_at_the_start(kind):
    """No sensor at first, lengths without a gain, sensors that are lost one after the other."""
    plant = firm(small(walk_W_sqrt_s=0.5))
    u = driven(plant, 50, missing=0.15, uneven=True)
    lose(u, slice(0, 3), slice(None))
    lose(u, slice(3, 5), [0, 2])
    u.law_W[20, 0] = np.nan
    u.degraded[30:34] = 2
    return steady(fixed(plant, kind), plant, u)


@cases_of(**BOTH)
def fixed_gain_opened_for_a_sensor(kind):
    plant, u = off_for_long()
    return steady(fixed(plant, kind, gate_sigma=30.0, period_s=5.0), plant, u)


@cases_of(**BOTH)
def fixed_gain_of_sensors_that_say_almost_everything(kind):
    plant = firm(small(noise_K=1e-5, walk_W_sqrt_s=1.0))
    return steady(fixed(plant, kind, gate_sigma=1e6), plant, driven(plant, 12, missing=0.1))


@case
def fixed_gain_with_films_and_fading():
    """Couplings without states of their own: the covariance never counts as settled."""
    effects = [e for name in ("speed_loss", "films", "radiation", "fading") for e in COUPLINGS[name]]
    plant, u = coupled(effects, 20, dt_s=0.5)
    return steady(fixed(plant, "constant"), plant, u)


@cases_of(
    constant={"kind": "constant"},
    constant_when_settled={"kind": "constant", "begin": "settled"},
    luenberger={"kind": "luenberger"},
    luenberger_when_settled={"kind": "luenberger", "begin": "settled"},
    constant_with_films={"kind": "constant", "effects": ("films", "radiation", "fading")},
    luenberger_without_a_nut={"kind": "luenberger", "moves": False},
)
def considering(kind, effects=(), moves=True, begin="the start"):
    """What is only roughly known widens every σ, at the start, in the steady state and out of it."""
    choice = {"kind": "luenberger"} if kind == "luenberger" else {"engine": "constant"}
    rough = [effect for name in effects for effect in COUPLINGS[name]]
    config, plant = described(
        3, 3, 3, moving=moves, learns=True, estimator=choice, **({"effect": rough} if rough else {})
    )
    u = _even(plant, 30 if rough else 70)
    lose(u, 12, 1)
    u.y_degC[20, 0] += 1e4
    u.usable[24] = False
    if not rough:
        u.y_degC[40:44] += 300.0
        u.dt_s[50] = 1.0
    estimator = fixed(plant, kind, gate_sigma=config.estimator.gate_sigma)
    if begin == "settled":
        return settled_run(estimator, plant, u, ends=(30,))
    return steady(estimator, plant, u.part(0, 25), u.part(25))


@case
def considering_with_sensors_that_say_almost_everything():
    _, plant = described(3, 3, 3, learns=True, estimator={"engine": "constant"})
    plant = replace(plant, noise_R_K2=np.full(3, 1e-11))
    return steady(fixed(plant, "constant", gate_sigma=1e7), plant, driven(plant, 8))
