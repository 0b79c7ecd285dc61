"""Heats of a whole log, and open loops."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from observer.config.estimator import EstimatorSettings
from observer.estimators.carry import carry_from as what_is_known
from observer.estimators.carry import carry_into
from observer.estimators.kalman import KalmanEstimator
from observer.estimators.tolerant import Tolerant
from observer.frames import EstimateBlock
from observer.history.smoother import smooth_heats
from observer.model.discretise import step_matrices
from observer.model.simulate import simulate, start
from tests.bits.digests import estimated, given, state_of
from tests.bits.shared import (
    COUPLINGS,
    LOADED,
    WIDE,
    Arrays,
    Cases,
    coupled,
    lose,
)
from tests.logs.inputs import driven, noise
from tests.logs.plants import described, rod, small
from tests.logs.rounding import firm

CASES = Cases()
case, cases_of = CASES.case, CASES.cases_of


# ---- the smoother ----


def smoothed(plant, *blocks, settings=WIDE) -> Arrays:
    found = smooth_heats(plant, settings, blocks)
    return {
        "given": given(plant, blocks),
        "heat_W": found.heat_W,
        "heat_sigma_W": found.heat_sigma_W,
        "residual_K": found.residual_K,
    }


@cases_of(
    eight_modes={"modes": 8},
    a_nut={"modes": 3, "moving": (1,)},
    one_heat={"modes": 3, "estimated": (True, False, False), "heat_rate_1_s": 5e-3},
)
def smoother(**plant_):
    plant = firm(rod(**plant_))
    u = driven(plant, 40, missing=0.3, uneven=True)
    return smoothed(plant, u.part(0, 1), u.part(1, 25), u.part(25))


@cases_of(**LOADED)
def smoother_coupled_by(effects):
    return smoothed(*coupled(effects, 16))


@case
def smoother_of_sensors_that_say_almost_everything():
    plant = firm(small(noise_K=1e-5))
    u = driven(plant, 16)
    u.usable[0, 0] = u.usable[3, 1] = u.usable[7, 0] = False
    return smoothed(plant, u, settings=EstimatorSettings(gate_sigma=1e6))


@case
def smoother_of_what_is_refused_or_no_number():
    plant = firm(small((1,)))
    u = driven(plant, 40)
    u.y_degC[12, 1] += 90.0
    u.y_degC[20:] += 60.0
    lose(u, slice(0, 2), slice(None))
    lose(u, 16, slice(None))
    u.law_W[9, 0] = np.nan
    return smoothed(plant, u, settings=EstimatorSettings())


@case
def smoother_over_more_than_a_segment():
    plant = firm(rod((0.1,), (0.0,), modes=1, grid=2))
    return smoothed(plant, driven(plant, 1040, missing=0.5))


# ---- open loop ----


def ahead(plant, u, sweep=None, first=None) -> Arrays:
    begun = start(plant, 21.0, u.law_W[0]) if first is None else first
    state, rows = simulate(plant, begun, u, sweep)
    return {"given": given(plant, u), "x": state, "~rows": rows}


@cases_of(
    eight_modes={"modes": 8}, a_nut={"modes": 4, "moving": (1,)}, forty_modes={"modes": 40, "moving": (1,)}
)
def open_loop(**plant_):
    plant = firm(rod(**plant_))
    return ahead(plant, driven(plant, 40, uneven=True))


@case
def open_loop_of_more_than_a_chunk():
    plant = firm(rod(modes=2, grid=2))
    return ahead(plant, driven(plant, 1030))


@case
def open_loop_of_modes_that_do_not_decay():
    plant = firm(rod(modes=3, film_W_m2K=0.0))
    u = driven(plant, 30)
    u.dt_s[1:] = 0.01 * (1 + np.arange(29)) ** 2
    return ahead(plant, u)


@cases_of(**LOADED)
def open_loop_coupled_by(effects):
    return ahead(*coupled(effects, 30))


@case
def open_loop_coupled_tightly():
    """Steps are divided until a body and its place come together slowly."""
    body = {"kind": "attached_mass", "target": "left", "capacity_J_K": 127.0, "conductance_W_K": 1000.0}
    return ahead(*coupled([body], 12, dt_s=10.0, moving=False, modes=16))


@cases_of(alone={"name": "body_at_the_nut"}, with_all={"name": "everything"})
def open_loop_of_known_sweeps(name):
    plant, u = coupled(COUPLINGS[name], 20, dt_s=1.0)
    rng = np.random.default_rng(5)
    sweep = 2e-5 * noise(rng, (len(u), len(plant.moving), 3, plant.modes))
    sweep[4:6, :, 1] = 0.0
    return ahead(plant, u, sweep)


@case
def tolerant_prediction():
    """A machine within its tolerances: begun from rest and from something else, learning and not."""
    _, plant = described(3, 3, 3, moving=True, learns=True, effect=COUPLINGS["films"])
    u, tolerant = driven(plant, 30, dt_s=30.0), Tolerant(plant)
    u.law_W[0], u.y_degC[0] = 0.0, 20.1
    found: Arrays = {}
    for begin in (0, 7):
        state = tolerant.begin(tolerant.initial(), u.part(begin, begin + 1))
        gaps = []
        for k in range(begin + 1, begin + 12):
            state, gap = tolerant.ahead(state, u.part(k, k + 1), learn=k % 3 != 0)
            gaps.append(np.stack(gap))
        found |= {f"~gap {begin}": np.stack(gaps)}
        found |= {f"~{name} {begin}": part for name, part in zip(("x", "theta", "P"), state, strict=True)}
    return found


@case
def carried_into_another_model():
    _, before = described(3, 4, 5, moving=True)
    _, now = described(5, 4, 5, moving=True, learns=True, effect=COUPLINGS["films"])
    one, other = KalmanEstimator(before, EstimatorSettings()), KalmanEstimator(now, EstimatorSettings())
    u, v = driven(before, 20), driven(now, 20)
    state, block = one.run(one.initial(), u)
    said = what_is_known(before, state, u.part(19), replace_last(block))
    assert said is not None
    begun = carry_into(now, other, said, v.part(19))
    assert begun is not None
    after, estimate = other.run(begun, driven(now, 10, seed=3).part(1))
    return {f"~{name}": array for name, array in estimated(after, estimate).items()} | {
        f"~begun {name}": array for name, array in state_of(begun).items()
    }


def replace_last(block: EstimateBlock) -> EstimateBlock:
    """The last estimate of a block."""
    return EstimateBlock(*(getattr(block, name)[-1:] for name in EstimateBlock.__dataclass_fields__))


# ---- steps ----


@cases_of(
    plain={"modes": 5},
    fading_heats={"modes": 3, "heat_rate_1_s": 1e-2},
    no_film={"modes": 3, "film_W_m2K": 0.0},
    no_heats={"modes": 3, "estimated": (False, False, False)},
)
def step_lengths(**plant_):
    plant = firm(rod(**plant_))
    # one heat that fades just as a mode does
    if len(plant.heat_decay_1_s) and plant.heat_decay_1_s[0] > 0.0:
        rates = plant.heat_decay_1_s.copy()
        rates[1] = plant.decay_1_s[1]
        plant = replace(plant, heat_decay_1_s=rates)
    steps = [step_matrices(plant, dt_s) for dt_s in (0.0, 1e-6, 0.02, 0.5, 0.7, 60.0, 36000.0)]
    names = steps[0]._fields
    return {"given": given(plant)} | {name: np.stack([getattr(s, name) for s in steps]) for name in names}
