"""The Kalman filter: alone, with couplings, and learning."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from observer.config.estimator import EstimatorSettings
from observer.estimators.kalman import KalmanEstimator
from observer.frames import Quality
from tests.bits.shared import (
    COUPLINGS,
    EVERY,
    LOADED,
    WIDE,
    Cases,
    coupled,
    filtered,
    learning,
    lose,
    off_for_long,
)
from tests.logs.inputs import driven
from tests.logs.plants import described, rod, small
from tests.logs.rounding import firm

CASES = Cases()
case, cases_of = CASES.case, CASES.cases_of


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


@cases_of(little={"off_K": 4.0}, much={"off_K": 60.0}, beyond_its_prior={"off_K": 900.0})
def kalman_opened_for_a_sensor(off_K):
    plant, u = off_for_long(off_K=off_K)
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
