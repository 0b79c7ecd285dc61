"""What cases of several modules share: their registry, and the plants, couplings and inputs they run with.

A case takes no arguments and returns arrays by name. "given" is a digest of what it began with, where LAPACK
or numpy had a hand in that. An array whose name begins with ~ went through a matrix product or LAPACK
on its way, so that another processor may give it other bits.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from observer.config.estimator import EstimatorSettings
from observer.estimators.kalman import KalmanEstimator
from observer.frames import FrameBlock, Inputs, NutPath, Quality
from tests.bits.digests import estimated, given
from tests.logs.inputs import driven, noise, to_and_fro
from tests.logs.plants import described, small
from tests.logs.rounding import firm

Arrays = dict[str, np.ndarray]
WIDE = EstimatorSettings(gate_sigma=1e9)


class Cases(dict[str, Callable[[], Arrays]]):
    """Cases by name, in the order in which they are written."""

    def case(self, function):
        """Enter a case under its name."""
        self[function.__name__] = function
        return function

    def cases_of(self, **variants):
        """Enter one case for each of the variants of a function."""

        def enter(function):
            for name, arguments in variants.items():
                self[f"{function.__name__}_{name}"] = lambda arguments=arguments: function(**arguments)
            return function

        return enter


def filtered(plant, *blocks, settings=None, state=None) -> Arrays:
    """The Kalman filter over consecutive blocks."""
    estimator = KalmanEstimator(plant, settings or EstimatorSettings())
    state, estimates = state or estimator.initial(), []
    for u in blocks:
        state, block = estimator.run(state, u)
        estimates.append(block)
    return {"given": given(plant, blocks)} | estimated(state, *estimates)


def lose(u: Inputs, steps, sensors, quality=Quality.MISSING) -> None:
    """Take the samples of some sensors at some steps away, in place."""
    u.usable[steps, sensors], u.quality[steps, sensors] = False, quality


def off_for_long(settled_s=5.0, off_K=60.0):
    """A sensor that is refused for minutes; now and then no sample comes of it."""
    plant = firm(small(initial_sigma_K=4.0))
    u = driven(plant, 70, dt_s=settled_s)
    u.law_W[:] = u.law_jump_W[:] = 0.0
    u.y_degC[6:50, 1] += off_K
    u.y_degC[40:45, 1] -= 0.8 * off_K
    lose(u, [10, 11, 22], 1)
    return plant, u


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
COUPLINGS["natural_convection"] = [{"kind": "natural_convection", "coefficient_W_m2K": 9.0}]
LOADED = {name: {"effects": effects} for name, effects in COUPLINGS.items()}


def coupled(effects, steps=24, *, moving=True, dt_s=4.0, modes=3):
    _, plant = described(modes, 3, 3, moving=moving, effect=effects)
    return plant, driven(plant, steps, dt_s=dt_s, missing=0.1, loss=True)


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
            path[name] = NutPath(at_s, at_m, offset, *np.full((2, len(at_s)), np.nan))
    fresh, quality = rng.random((steps, c)) < 0.9, np.zeros((steps, c), np.int8)
    dt_s = np.diff(time_s, prepend=0.0)
    return FrameBlock(config.channels, time_s, dt_s, values, fresh, quality, np.zeros((steps, c)), path)
