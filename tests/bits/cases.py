"""Runs through everything that is compiled, by the doors that the product itself uses.

A case takes no arguments and returns arrays by name. "given" is a digest of what it began with, where LAPACK
or numpy had a hand in that. An array whose name begins with ~ went through a matrix product or LAPACK
on its way, so that another processor may give it other bits.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from observer.align.aligner import Aligner, AlignPlan, Position
from observer.align.plausibility import Kind, Limits
from observer.estimators.carry import taken
from observer.estimators.carry import told as what_is_known
from observer.estimators.constant_gain import ConstantGainEstimator
from observer.estimators.design.gains import everything
from observer.estimators.design.riccati import steady_covariance
from observer.estimators.kalman import KalmanEstimator
from observer.estimators.luenberger import LuenbergerEstimator
from observer.estimators.selftest import SelfTest
from observer.estimators.tolerant import Tolerant
from observer.frames import EstimateBlock, FrameBlock, Inputs, NutPath, Quality, Reading
from observer.history.conjugate_gradient import stepwise_heats
from observer.history.smoother import smooth_heats
from observer.history.stacked import StackedProblem
from observer.model.discretise import step_matrices
from observer.model.drive import Drive
from observer.model.rod import moving
from observer.model.rod.moving import PathState, reversals
from observer.model.simulate import simulate, start
from observer.tables.estimator import EstimatorSettings
from tests.bits.made import described, driven, firm, given, noise, state_of, to_and_fro, told, words
from tests.estimators.plants import rod, small

Arrays = dict[str, np.ndarray]
CASES: dict[str, Callable[[], Arrays]] = {}
WIDE = EstimatorSettings(gate_sigma=1e9)


def case(function: Callable[[], Arrays]) -> Callable[[], Arrays]:
    """Enter a case under its name."""
    CASES[function.__name__] = function
    return function


def cases_of(**variants):
    """Enter one case for each of the variants of a function."""

    def enter(function):
        for name, arguments in variants.items():
            CASES[f"{function.__name__}_{name}"] = lambda arguments=arguments: function(**arguments)
        return function

    return enter


def filtered(plant, *blocks, settings=None, state=None) -> Arrays:
    """The Kalman filter over consecutive blocks."""
    estimator = KalmanEstimator(plant, settings or EstimatorSettings())
    state, estimates = state or estimator.initial(), []
    for u in blocks:
        state, block = estimator.run(state, u)
        estimates.append(block)
    return {"given": given(plant, blocks)} | told(state, *estimates)


def lose(u: Inputs, steps, sensors, quality=Quality.MISSING) -> None:
    """Take the samples of some sensors at some steps away, in place."""
    u.usable[steps, sensors], u.quality[steps, sensors] = False, quality


# ---- the Kalman filter ----


@cases_of(
    one_mode_one_sensor={"sensors_m": (0.2,), "sources_m": (0.0,), "modes": 1, "grid": 2},
    eight_modes={"modes": 8},
    a_wide_grid={"modes": 4, "grid": 13},
    heats_that_fade={"modes": 4, "heat_rate_1_s": 2e-3},
    one_heat_of_three={"modes": 4, "estimated": (False, True, False)},
    no_heat_at_all={"modes": 4, "estimated": (False, False, False)},
    five_sources={"modes": 3, "sources_m": (0.0, 0.1, 0.3, 0.5, 0.6)},
)
def kalman(**plant_):
    plant = firm(rod(**plant_))
    return filtered(plant, driven(plant, 50, missing=0.2, uneven=True))


@cases_of(still={"moving": ()}, moving={"moving": (1,)})
def kalman_of_forty_modes_and_eight_sensors(moving):
    places = (0.03, 0.1, 0.17, 0.25, 0.33, 0.4, 0.48, 0.57)
    plant = firm(rod(places, modes=40, grid=21, moving=moving))
    return filtered(plant, driven(plant, 5, missing=0.1))


@cases_of(estimated={"moving": (0,)}, by_law_alone={"moving": (1,)}, two={"moving": (0, 2)})
def kalman_with_a_nut(moving):
    plant = firm(small(moving, heat_rate_1_s=1e-3))
    return filtered(plant, driven(plant, 50, uneven=True))


@case
def kalman_of_a_configuration():
    """Prescribed ends, an expansion, noise of the field, a nut that moves."""
    ends = {"left": {"kind": "prescribed", "channel": "l"}, "right": {"kind": "prescribed", "channel": "r"}}
    _, plant = described(
        moving=True,
        boundary=ends,
        estimator={"field_noise_K_sqrt_s": 0.05},
        output={"positions_m": [0.0, 0.4]},
    )
    return filtered(plant, driven(plant, 40))


@case
def kalman_in_steps_of_one():
    plant = firm(small((1,)))
    u = driven(plant, 20, missing=0.2, uneven=True)
    return filtered(plant, *(u.part(k, k + 1) for k in range(len(u))))


@case
def kalman_of_no_steps():
    plant = firm(small())
    return filtered(plant, driven(plant, 3).part(0, 0))


@case
def kalman_in_steps_of_more_lengths_than_a_table_holds():
    plant = firm(rod(modes=2, grid=2))
    u = driven(plant, 150)
    u.dt_s[1:] = 1e-6 * (1 + 7919 * (np.arange(149) % 75) ** 2)
    u.dt_s[[20, 90]] = 0.0
    u.dt_s[[30, 31]] = 4e-7, 600.0  # less than a microsecond, and ten minutes
    return filtered(plant, u)


@case
def kalman_whose_sensors_are_refused():
    """One off, half of them, most of them for two steps, and then for good."""
    plant = firm(rod(modes=4))
    u = driven(plant, 60)
    u.law_W[:] = u.law_jump_W[:] = 0.0
    u.y_degC[8:14, 1] += 90.0
    u.y_degC[18:24, :2] += 90.0
    u.y_degC[28:30] += 90.0
    u.y_degC[34:] += 40.0
    lose(u, slice(10, 12), 1)
    return filtered(plant, u)


def _off_for_long(settled_s=5.0, off_K=60.0):
    """A sensor that is refused for minutes; now and then no sample comes of it."""
    plant = firm(small(initial_sigma_K=4.0))
    u = driven(plant, 70, dt_s=settled_s)
    u.law_W[:] = u.law_jump_W[:] = 0.0
    u.y_degC[6:50, 1] += off_K
    u.y_degC[40:45, 1] -= 0.8 * off_K
    lose(u, [10, 11, 22], 1)
    return plant, u


@cases_of(little={"off_K": 4.0}, much={"off_K": 60.0}, beyond_its_prior={"off_K": 900.0})
def kalman_opened_for_a_sensor(off_K):
    plant, u = _off_for_long(off_K=off_K)
    return filtered(plant, u, settings=EstimatorSettings(gate_sigma=4.0 if off_K < 10.0 else 30.0))


@case
def kalman_that_lost_its_nut():
    plant = firm(small((1,)))
    u = driven(plant, 40, dt_s=4.0)
    u.degraded[3:5] = 1
    u.degraded[8:24] = 2
    u.degraded[30] = 2
    u.dt_s[20] = 70.0
    return filtered(plant, u)


@case
def kalman_of_what_is_stale_silent_or_no_number():
    plant = firm(small((1,)))
    u = driven(plant, 50)
    lose(u, slice(0, 3), slice(None))
    lose(u, slice(10, 15), slice(None))
    lose(u, 17, slice(None), Quality.STALE)
    lose(u, 18, 0, Quality.STALE)
    lose(u, 20, 2, Quality.REJECTED)
    u.usable[22] = False  # good, but no sample at this tick
    u.y_degC[24, 1], u.y_degC[25, 0] = np.nan, np.inf
    u.law_W[28, 1] = u.z_start[29, 0] = u.z_end[30, 1] = u.moving_B[31, 0, 1] = np.nan
    u.law_W[32, 0] = np.inf
    return filtered(plant, u)


@case
def kalman_that_overflows():
    plant = firm(small())
    estimator = KalmanEstimator(plant, WIDE)
    state, _ = estimator.run(estimator.initial(), driven(plant, 3))
    x = state.x_hat.copy()
    x[-1] = np.inf
    return filtered(plant, driven(plant, 4, seed=2), settings=WIDE, state=replace(state, x_hat=x))


@case
def kalman_of_sensors_that_say_almost_everything():
    """What P expects is more than 10⁸ of the noise: one sensor after the other, in Joseph's form."""
    plant = firm(small(noise_K=1e-5))
    u = driven(plant, 20)
    u.usable[0, 0] = u.usable[3, 1] = u.usable[7, 0] = False
    return filtered(plant, u, settings=EstimatorSettings(gate_sigma=1e6))


@case
def kalman_that_begins_beside_a_prescribed_end():
    """The modes see little of a uniform temperature there; an even number of sensors besides."""
    plant = firm(small())
    C = plant.rows.C.copy()
    C[0] *= 0.01
    plant = replace(plant, rows=replace(plant.rows, C=C))
    u = driven(plant, 6)
    u.y_degC[0] = 35.0, 21.0, 24.0
    u.usable[0, 2] = False
    return filtered(plant, u, settings=WIDE)


# ---- what couples the states ----

COUPLINGS = {
    "speed_loss": [{"kind": "speed_convection", "gain": 1.0}],
    "films": [
        {"kind": "uneven_convection", "from_m": 0.1, "to_m": 0.3, "extra_W_m2K": 40.0},
        {"kind": "uneven_convection", "from_m": 0.6, "to_m": 0.8, "extra_W_m2K": -10.0},
    ],
    "body_at_an_end": [
        {
            "kind": "attached_mass",
            "target": "left",
            "capacity_J_K": 900.0,
            "conductance_W_K": 4.0,
            "loss_W_K": 0.3,
        }
    ],
    "body_at_the_nut": [
        {"kind": "attached_mass", "target": "nut", "capacity_J_K": 1500.0, "conductance_W_K": 8.0}
    ],
    "lags": [
        {"kind": "sensor_lag", "target": "t2", "time_constant_s": 20.0},
        {"kind": "sensor_lag", "target": "t3", "time_constant_s": 90.0},
    ],
    "radiation": [{"kind": "radiation", "emissivity": 0.8}],
    "fading": [
        {"kind": "friction_fade", "target": "nut", "per_K": 0.02},
        {"kind": "friction_fade", "target": "right", "per_K": -0.01, "reference_degC": 22.0},
    ],
}
COUPLINGS["everything"] = [effect for effects in COUPLINGS.values() for effect in effects]
LOADED = {name: {"effects": effects} for name, effects in COUPLINGS.items()}


def coupled(effects, steps=24, *, moving=True, dt_s=4.0, modes=3):
    _, plant = described(modes, 3, 3, moving=moving, effect=effects)
    return plant, driven(plant, steps, dt_s=dt_s, missing=0.1, loss=True)


@cases_of(**LOADED)
def kalman_coupled_by(effects):
    return filtered(*coupled(effects))


@case
def kalman_coupled_with_a_nut_over_its_stroke():
    return filtered(*coupled(COUPLINGS["everything"], moving=False))


@case
def kalman_coupled_in_one_place():
    """A nut that stands still between two that run: what it passes to its body goes with its place."""
    plant, u = coupled(COUPLINGS["body_at_the_nut"], 12)
    u.moving_B[4:8], u.moving_C[4:8] = u.moving_B[4], u.moving_C[4]
    u.moving_B[8:], u.moving_C[8:] = 3.0 * u.moving_B[8:], u.moving_C[8:]
    return filtered(plant, u)


# ---- what is learnt of the machine ----

EVERY = [
    "convection", "conductivity", "heat_capacity", "ambient_K", "end_W_K", "law", "offset_K", "position_m",
    "lag_s",
]  # fmt: skip


def learning(learn, *, resting=True, steps=24, **tables):
    estimator = {"gate_sigma": 1e3} | tables.pop("estimator", {})
    if learn is not None:
        estimator["learn"] = learn
    config, plant = described(3, 3, 3, moving=True, learns=True, estimator=estimator, **tables)
    u = driven(plant, steps, dt_s=2.0, missing=0.1)
    u.usable[0], u.quality[0], u.y_degC[0] = True, 0, 20.1
    if not resting:
        u.y_degC[0, 1] = 29.0
    return config, plant, u


@cases_of(
    as_usual={"learn": None},
    all_of_it={"learn": EVERY},
    all_of_it_when_warm={"learn": EVERY, "resting": False},
    nothing={"learn": []},
    laws_alone={"learn": ["law"], "tolerance": {"lag_s": 0.0, "position_m": 0.0, "offset_K": 0.0}},
    **{f"{key}_alone": {"learn": [key], "steps": 12} for key in EVERY},
)
def kalman_that_learns(learn, **how):
    config, plant, u = learning(learn, **how)
    return filtered(plant, u, settings=config.estimator)


@case
def kalman_that_learns_of_a_machine_that_runs():
    """It begins under a law, loses its nut, refuses most of its sensors, and opens again."""
    config, plant, u = learning(EVERY, steps=40, estimator={"gate_sigma": 6.0})
    u.law_W[0, 0] = 5.0
    u.degraded[5:9] = 2
    u.y_degC[12:16] += 60.0
    u.y_degC[20:36, 1] += 60.0
    u.dt_s[10] = 0.0
    return filtered(plant, u, settings=config.estimator)


@case
def kalman_that_learns_with_couplings():
    config, plant, u = learning(EVERY, steps=12, effect=COUPLINGS["everything"])
    return filtered(plant, u._replace(loss_1_s=np.full(12, 1e-3)), settings=config.estimator)


# ---- fixed gains ----


def steady(estimator, plant, *blocks, state=None) -> Arrays:
    """A run by fixed gains; what they are goes into what is given, for LAPACK finds them."""
    state, estimates = state or estimator.initial(), []
    begun = state
    for u in blocks:
        state, block = estimator.run(state, u)
        estimates.append(block)
    cut = replace(plant, learning=None)
    K = estimator.gain(step_matrices(cut, 0.5), everything(cut))
    return {"given": given(plant, blocks, K, begun.P)} | told(state, *estimates)


def at_steady_state(estimator, plant, u, period_s=0.5):
    """The state after the first step, with the covariance that it would have after very many."""
    cut = replace(plant, learning=None)
    step = step_matrices(cut, period_s)
    steady = steady_covariance(cut, step, estimator.gain(step, everything(cut)))
    assert steady is not None
    state, _ = estimator.run(estimator.initial(), u.part(0, 1))
    return replace(state, P=0.5 * (steady.P + steady.P.T))


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
    return settled_run(fixed(plant, kind, gate_sigma=1e6), plant, u)


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
    plant, u = _off_for_long()
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
def allowing(kind, effects=(), moves=True, begin="the start"):
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
def allowing_with_sensors_that_say_almost_everything():
    _, plant = described(3, 3, 3, learns=True, estimator={"engine": "constant"})
    plant = replace(plant, noise_R_K2=np.full(3, 1e-11))
    return steady(fixed(plant, "constant", gate_sigma=1e7), plant, driven(plant, 8))


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
    return {"given": given(plant, u), "x": state.x, "~rows": rows}


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
    begun = taken(now, other, said, v.part(19))
    assert begun is not None
    after, estimate = other.run(begun, driven(now, 10, seed=3).part(1))
    return {f"~{name}": array for name, array in told(after, estimate).items()} | {
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


@case
def stepwise_heat_history():
    """Step by step: from rest, with sensors that are away, and one step that no sensor saw."""
    plant = firm(rod((0.0, 0.3, 0.6), modes=3, law_uncertainty=0.0))
    rng, K, s = np.random.default_rng(4), 40, 3
    weight = np.where(rng.random((K, s)) < 0.85, 20.0, 0.0)
    weight[12] = 0.0
    rise = 0.02 * np.arange(K)[:, None] * np.array([1.0, 2.0, 0.5]) + 0.05 * noise(rng, (K, s))
    rise[30:] = rise[29]
    problem = StackedProblem(
        6.0 * np.arange(K), 6.0, np.zeros((K - 1, s, 3)), rise, weight, np.zeros((K * s, 0)), np.zeros(0)
    )
    found = {
        "~heat_W": stepwise_heats(plant, problem, rise),
        "~quick": stepwise_heats(plant, problem, np.where(weight > 0.0, 0.001 * rise, 0.0)),
        "~exact": stepwise_heats(plant, problem._replace(weight_1_K=1e9 * weight), rise),
    }
    # more sensors than heats, which no heat explains: down to where no step helps; and heats hard to tell
    for name, sources_m in {"~one": (0.3,), "~many": (0.0, 0.2, 0.22, 0.24, 0.6)}.items():
        plant = firm(rod((0.1, 0.2, 0.45), sources_m, modes=8, law_uncertainty=0.0))
        response = np.zeros((K - 1, s, len(sources_m)))
        sure = problem._replace(weight_1_K=np.full((K, s), 1e9), response_K_W=response)
        found[name] = stepwise_heats(plant, sure, rise)
    found["~far_off"] = stepwise_heats(plant, sure, 1e6 * rise)  # the differences of such squares are coarse
    return found


# ---- paths of nuts ----


def path_of(time_s, position_m, driven_m_s=None, every=3):
    """Samples as a path, so many in a step; the fifth step has none."""
    n = len(time_s)
    offset = np.minimum(every * np.arange(-(-n // every) + 1), n)
    offset = np.insert(offset, 5, offset[5]) if len(offset) > 6 else offset
    driven_m_s = np.full(n, np.nan) if driven_m_s is None else driven_m_s
    return NutPath(np.asarray(time_s, float), np.asarray(position_m, float), offset, driven_m_s)


def _runs():
    """Samples of a nut of 0.2 m/s, fine and coarse, even and not, late, twice, and with its speed told."""
    rng = np.random.default_rng(11)
    gaps = {
        "fine": np.full(120, 0.02),
        "coarse": 0.5 * (0.7 + 0.6 * rng.random(120)),
        "sparse": np.full(60, 1.3),
        "late": np.concatenate(
            [np.full(40, 0.4), [4.0], np.full(10, 0.4), [90.0, 0.4, 5000.0, 0.4, 0.0, 1e-4]]
        ),
        "never told": np.full(30, 7.0),
        "long": np.concatenate([np.full(20, 0.5), np.full(4, 20.0)]),
    }
    for name, gap_s in gaps.items():
        time_s = 100.0 + np.cumsum(gap_s)
        position_m = to_and_fro(0.2 * (time_s - 100.0), 0.2, 0.8)
        yield name, time_s, position_m, None
    gap_s = 0.4 * (0.7 + 0.6 * rng.random(90))
    time_s = np.cumsum(gap_s)
    position_m = to_and_fro(0.2 * time_s, 0.2, 0.8)
    told_m_s = np.full(90, 0.2)
    told_m_s[[4, 5, 9, 20]] = np.nan
    yield "told", time_s, position_m, told_m_s
    late_s = time_s + np.where(np.arange(90) >= 60, 9.0, 0.0) + np.where(np.arange(90) >= 70, 3.5, 0.0)
    yield "told and late", late_s, to_and_fro(0.2 * late_s, 0.2, 0.8), told_m_s
    yield "of another lead", time_s, position_m, 2.5 * told_m_s
    stands = np.where(np.arange(90) // 20 % 2 == 0, position_m, 0.5)
    yield "standing", time_s, stands, np.where(stands == 0.5, 0.0, 0.2)
    stands = np.full(90, 0.4)
    stands[50:] = 0.4 + 0.001 * np.arange(40)
    yield "creeping", time_s, stands, None
    nowhere = position_m.copy()
    nowhere[[8, 30]] = -0.3, 1.4
    yield "off the screw", time_s, nowhere, None
    brief_s = np.cumsum(np.where(np.arange(90) < 4, 1e-3, gap_s))
    yield "brief at first", brief_s, to_and_fro(0.2 * brief_s, 0.2, 0.8), None


@case
def nut_turns():
    found: Arrays = {}
    for name, time_s, position_m, told_m_s in _runs():
        state, ends_m = reversals(PathState(), path_of(time_s, position_m, told_m_s), 0.6)
        found |= {f"{name} ends_m": ends_m, f"{name} state": state.scalars}
    time_s, nowhere_m = np.arange(6.0), np.array([0.2, 0.3, np.nan, 0.4, 0.5, 0.6])
    state, _ = reversals(PathState(), path_of(time_s, nowhere_m), 0.6)
    return found | {"no number state": state.scalars}


def _nut(dwell=0.0):
    effects = {"effect": [{"kind": "dwell", "target": "nut", "fraction": dwell}]} if dwell else {}
    config, plant = described(4, 2, 2, moving=True, **effects)
    return config, plant


@case
def nut_columns():
    _, plant = _nut()
    table = plant.moving[0].table
    found: Arrays = {"given": given(table)}
    for name, time_s, position_m, told_m_s in _runs():
        path = path_of(time_s, position_m, told_m_s)
        dt_s = np.diff(time_s[np.maximum(path.offset - 1, 0)])
        nut, B, C = moving.columns(table, moving.start(table), dt_s, path)
        found |= {f"{name} B": B, f"{name} C": C, f"{name} state B": nut.sum_B, f"{name} state C": nut.sum_C}
        found |= {f"{name} state": np.append(nut.path.scalars, nut.weight_s)}
    return found


@case
def nut_columns_at_places():
    _, plant = _nut()
    table = plant.moving[0].table
    found: Arrays = {"given": given(table)}
    for name, places_m in {"one": [0.4], "ends": [0.2, 0.8], "edges": [-1.0, 0.0, 0.01, 1.0, 3.0]}.items():
        B, C = moving.columns_at(table, places_m)
        found |= {f"{name} B": B, f"{name} C": C}
    return found


@case
def nut_columns_where_it_turns():
    _, plant = _nut()
    table = plant.moving[0].table
    path = path_of(*next(iter(_runs()))[1:])
    _, B, C = moving.columns_at_ends(table, PathState(), np.full(len(path.offset) - 1, 0.06), path)
    return {"given": given(table), "B": B, "C": C}


# ---- from frames to inputs ----


def frames_of(config, steps=40, seed=6):
    """Frames of every channel of a configuration, with a nut that runs to and fro."""
    rng, c = np.random.default_rng(seed), len(config.channels)
    time_s = 0.5 * np.arange(steps)
    values = 20.0 + 0.05 * noise(rng, (steps, c))
    path = {}
    for j, name in enumerate(config.channels):
        if name.endswith("rpm"):
            values[:, j] = np.where(np.arange(steps) // 8 % 2 == 0, 1200.0, 0.0)
        if name == "nut_position_m":
            at_s = np.sort(20.0 * rng.random(3 * steps))
            at_m = to_and_fro(0.2 * at_s, 0.2, 0.8)
            values[:, j] = to_and_fro(0.2 * time_s, 0.2, 0.8)
            offset = np.concatenate([[0], np.searchsorted(at_s, time_s, side="right")])
            path[name] = NutPath(at_s, at_m, offset, np.full(len(at_s), np.nan))
    fresh, quality = rng.random((steps, c)) < 0.9, np.zeros((steps, c), np.int8)
    dt_s = np.diff(time_s, prepend=0.0)
    return FrameBlock(config.channels, time_s, dt_s, values, fresh, quality, np.zeros((steps, c)), path)


def _drive(config, plant, frames, parts=(0, 1, 15, 40)) -> Arrays:
    drive = Drive(config, plant)
    state, found = drive.initial(), []
    for begin, end in itertools.pairwise(parts):
        cut = slice(begin, end)
        path = {}
        for name, p in frames.path.items():
            own = slice(p.offset[begin], p.offset[end])
            path[name] = NutPath(
                p.time_s[own],
                p.position_m[own],
                p.offset[begin : end + 1] - p.offset[begin],
                p.driven_m_s[own],
            )
        part = FrameBlock(
            frames.channels, frames.time_s[cut], frames.dt_s[cut], frames.values[cut], frames.fresh[cut],
            frames.quality[cut], frames.age_s[cut], path,
        )  # fmt: skip
        state, u = drive.run(state, part)
        found.append(u)
    u = Inputs.joined(found)
    rest = {"law_W": state.law_W, "z": state.z, "running_s": state.running_s}
    rest |= {"times_s": np.array([state.begin_s, state.last_s])}
    return {"given": given(plant, frames.values)} | u._asdict() | {f"state.{k}": v for k, v in rest.items()}


EFFECTS_OF_INPUTS = [
    {"kind": "speed_convection", "gain": 1.0},
    {"kind": "coolant", "conductance_W_K": 2.0, "inlet_degC": 15.0},
    {"kind": "ambient_drift", "rate_K_h": 3.0},
    {"kind": "sensor_bias", "target": "t1", "offset_K": 0.3},
    {"kind": "sensor_drift", "target": "t2", "rate_K_h": 2.0},
    {"kind": "run_in", "target": "left", "fraction": 0.3, "time_s": 300.0},
    {"kind": "dwell", "target": "nut", "fraction": 0.2},
]


@cases_of(
    plain={"tables": {}},
    effects={"tables": {"effect": EFFECTS_OF_INPUTS}},
    channels={
        "tables": {
            "ambient": {"channel": "ambient_degC"},
            "boundary": {"left": {"kind": "prescribed", "channel": "left_degC"}},
            "output": {"positions_m": [0.1, 0.9]},
        }
    },
)
def drive(tables):
    """What is missing, held, known late or never, and a nut whose place is not known."""
    screw = described(2, 2, 2)[0].screw.model_dump(exclude_unset=True) | {"expansion_1_K": 11.8e-6}
    config, plant = described(3, 2, 2, moving=True, screw=screw, **tables)
    frames = frames_of(config)
    at = {name: j for j, name in enumerate(config.channels)}
    for name, steps, quality in (
        ("t1_degC", slice(4, 7), 1), ("nut_position_m", slice(9, 12), 2),
        ("screw_speed_rpm", slice(18, 20), 2), ("screw_speed_rpm", slice(0, 2), 1),
        ("ambient_degC", slice(0, 3), 1), ("left_degC", slice(6, 8), 3),
    ):  # fmt: skip
        if name in at:
            frames.quality[steps, at[name]] = quality
            if steps.start == 0 or name == "screw_speed_rpm":
                frames.values[steps, at[name]] = np.nan
    return _drive(config, plant, frames)


@case
def drive_without_a_nut():
    config, plant = described(3, 2, 2)
    return _drive(config, plant, frames_of(config))


@case
def drive_of_two_nuts():
    nuts = [
        {"name": n, "shape": "nut", "length_m": 0.08, "stroke_m": [0.2, 0.8],
         "position_channel": "nut_position_m", "speed_channel": "screw_speed_rpm", "heat_W_rpm": 0.006}
        for n in ("nut", "other")
    ]  # fmt: skip
    config, plant = described(3, 2, 2, source=nuts)
    return _drive(config, plant, frames_of(config))


# ---- from readings to frames ----

CHANNELS = ("t1_degC", "t2_degC", "air_degC", "speed_rpm", "nut_position_m", "slow_degC")


def _plan(*, ambient=2, periods=(0.5, 0.5, math.nan, 0.1, 0.02, math.nan), speed=3):
    inf, c = math.inf, len(CHANNELS)
    low, high = np.full(c, -inf), np.full(c, inf)
    low[0], high[0], high[3] = -40.0, 150.0, 4000.0
    rate, slack = np.full(c, inf), np.zeros(c)
    rate[0], slack[0] = 5.0, 0.5
    above, below = np.full(c, inf), np.full(c, inf)
    above[:2], below[:2] = 45.0, 25.0
    limits = Limits(
        (Kind.OTHER,) * c, low, high, rate, above, below, slack, np.column_stack([low, high]), ambient, 21.0
    )
    noise_K = np.array([0.05, 0.05, *(math.nan,) * 4])
    positions = (Position(4, speed, 0.01), Position(5))
    return AlignPlan(CHANNELS, positions, np.array(periods, float), noise_K, 0.5, limits)


def _readings(seed=8, count=900):
    """Readings and ticks (floats) in the order in which they come."""
    rng = np.random.default_rng(seed)
    events: list[Reading | float] = []
    for k in range(count):
        t = 1e6 + 0.1 * k
        late = 0.3 * float(rng.random()) if k % 11 == 0 else 0.0
        if k % 5 == 0:
            one = 20.0 + 0.002 * k + 0.05 * float(noise(rng, ()))
            two = 21.0 + 0.05 * float(noise(rng, ())) if k < 300 or 700 < k < 760 else 21.5
            values, faults = {"t1_degC": one, "t2_degC": two}, {}
            if k % 85 == 0:
                values["t1_degC"] = [200.0, -60.0, 80.0, 30.0, -10.0, one + 4.0][k // 85 % 6]
            if k % 95 == 0:
                values["t1_degC"], faults = (
                    math.nan,
                    {"t1_degC": ["open_circuit", "missing", ""][k // 95 % 3]},
                )
            if k % 120 == 0:
                values = {"t2_degC": math.inf}
            if k % 130 == 0:
                values = {"t2_degC": [90.0, -30.0][k // 130 % 2]}
            events.append(Reading(t - late, values, faults))
        if k % 20 == 0:
            events.append(Reading(t, {"air_degC": 20.0 + 0.01 * k}))
        if k % 37 == 0 or k > 500:
            events.append(Reading(t, {"slow_degC": 20.0 + 0.1 * (k // 100)}))
        if not 200 < k < 240 and k % 3 == 0:
            faults = {"speed_rpm": "timeout"} if 400 < k < 420 else {}
            events.append(Reading(t, {"speed_rpm": 1200.0 if k % 9 else 5000.0}, faults))
        at_m = float(to_and_fro(np.array(0.02 * k), 0.2, 0.8))
        burst = 4 if k % 50 == 0 else 1
        for i in range(burst):
            events.append(Reading(t - late + 1e-4 * i, {"nut_position_m": at_m + 0.001 * (i // 2)}))
        if k % 7 == 0:
            events.append(Reading(t - 0.35, {"nut_position_m": at_m - 0.05}))
        if k % 5 == 4 and not 600 < k < 640:
            events.append(t + 0.05)
    return events


@cases_of(
    usual={},
    fixed_air={"ambient": -1},
    unknown_periods={"periods": (math.nan,) * 6},
    unknown_speed={"speed": -1},
)
def aligned(**plan_):
    aligner = Aligner(_plan(**plan_))
    frames, faults = [aligner.tick(1e6 - 0.5)], []
    for event in _readings():
        if isinstance(event, Reading):
            aligner.ingest(event)
        else:
            frames.append(aligner.tick(event))
            faults.append(aligner.faults)
    names = ("time_s", "dt_s", "values", "fresh", "quality", "age_s")
    found = {name: np.concatenate([getattr(f, name) for f in frames]) for name in names}
    for channel in frames[0].path:
        parts = [f.path[channel] for f in frames]
        found |= {
            f"{channel} {name}": np.concatenate([getattr(p, name) for p in parts]) for name in NutPath._fields
        }
    return found | {"faults": words(faults)}


# ---- the self-test ----


def _judged(K=420):
    """Steps of five seconds in which one thing after the other fails, and a nut that goes its own way."""
    rng, s, m = np.random.default_rng(9), 4, 3
    time_s = 5.0 * np.arange(1, K + 1)
    nu = noise(rng, (K, s))
    nu[40:110, 0] += 2.0
    nu[40:110, 1] = np.where(np.arange(70) // 12 % 2 == 0, 1.5, -1.5)
    nu[40:110, 2] *= 4.0
    nu[150:170, 3] += 40.0
    nu[30:34, 1] = np.nan
    given_quality, seen = np.zeros((K, s), np.int8), np.zeros((K, s), np.int8)
    seen[150:170, 3] = 3
    seen[155:158, 3], nu[155:158, 3] = 3, np.nan
    given_quality[200:205, 0] = seen[200:205, 0] = 1
    law = np.where((np.arange(K) // 30 % 2 == 1)[:, None], 20.0 + 5.0 * np.arange(m), 0.0)
    heat = law + noise(rng, (K, m))
    heat[220:260, 0] += 80.0
    heat[280:330] += 25.0
    heat[335:345, 1] += 400.0
    sigma = np.full((K, m), 3.0)
    sigma[:12], sigma[350:355, 1] = 28.0, 25.0
    quality = np.zeros(K, np.int8)
    quality[60:64], quality[100] = 4, 3
    grid, none = np.zeros((K, 2)), np.zeros((K, 0))
    block = EstimateBlock(
        time_s, heat, sigma, grid, grid, none, none, 0.1 * nu, seen, quality, np.full((K, s), 0.1), law,
        none, none,
    )  # fmt: skip
    at_s = 1.0 * np.arange(5 * K)
    runs_m_s = np.where(at_s < 1500.0, 0.05, 0.2)
    position_m = to_and_fro(np.cumsum(np.where((at_s > 600.0) & (at_s < 640.0), 0.0, runs_m_s)), 0.1, 0.5)
    told_m_s = np.full(len(at_s), 0.06)
    told_m_s[(at_s > 900.0) & (at_s < 1000.0)] = 0.25
    told_m_s[(at_s > 1100.0) & (at_s < 1300.0)] = 0.15
    told_m_s[[50, 51]] = np.nan
    path = NutPath(at_s, position_m, 5 * np.arange(K + 1), told_m_s)
    return time_s, given_quality, block, path


@cases_of(
    with_laws={"laws": ("q0", "q1", "q2")},
    one_law={"laws": ("q1",)},
    a_nut={"laws": ("q0", "q1"), "nut": True},
)
def selftest(laws, nut=False):
    plant = firm(rod(modes=2, moving=(1,) if nut else ()))
    test, (time_s, quality, block, path) = SelfTest(plant, laws), _judged()
    u = driven(plant, len(time_s))._replace(
        time_s=time_s, dt_s=np.diff(time_s, prepend=time_s[0]), quality=quality
    )
    K = len(time_s)
    frames = FrameBlock(
        (), time_s, u.dt_s, np.zeros((K, 0)), np.zeros((K, 0), np.bool_), np.zeros((K, 0), np.int8),
        np.zeros((K, 0)), {"nut_position_m": path},
    )  # fmt: skip
    state, motion, u = test.watch(test.initial(), frames, u)
    state, judged = test.run(state, motion, u, block)
    found = {f"state.{name}": part for name, part in state._asdict().items()}
    found |= {"findings": words((test.findings(state), test.history(state)))}
    return found | {"motion": motion, "degraded": u.degraded, "quality": judged.quality}


@case
def the_whole_path():
    """Frames, inputs, what is learnt, the self-test: a machine as a service runs it."""
    config, plant = described(4, 3, 3, moving=True, learns=True)
    frames, drive_ = frames_of(config, 30), Drive(config, plant)
    test = SelfTest(plant, plant.source_names)
    _, u = drive_.run(drive_.initial(), frames)
    state, motion, u = test.watch(test.initial(), frames, firm(u))
    estimator = KalmanEstimator(plant, config.estimator)
    last, block = estimator.run(estimator.initial(), u)
    state, judged = test.run(state, motion, u, block)
    return (
        {"given": given(plant, u)} | told(last, judged) | {f"test.{k}": v for k, v in state._asdict().items()}
    )
