"""Logs of known heats, from the finite volumes: Li's axis warming and cooling, and Lathe's spindle."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from observer.config import Config
from observer.frames import FloatArray, Inputs
from observer.model.build import build_plant
from observer.model.plant import Plant
from tests.reference.cases import config_of
from tests.truth.bar import Bar, Mesh, band_share, point_share
from tests.truth.rod import Heat, simulate

CELLS = 300


@dataclass(frozen=True, slots=True)
class HeatCase:
    """A machine whose heats are known: `heat_W` (K, m), mean over the step that ends at each row."""

    config: Config
    time_s: FloatArray
    heat_W: FloatArray
    temperature_degC: FloatArray

    @property
    def plant(self) -> Plant:
        """The plant of the configuration."""
        return build_plant(self.config)

    def measured(self, seed: int, noise_K: float = 0.1) -> FloatArray:
        """The sensors' values (K, s) with white noise."""
        rng = np.random.default_rng(seed)
        return self.temperature_degC + noise_K * rng.standard_normal(self.temperature_degC.shape)

    def inputs(self, seed: int, noise_K: float = 0.1) -> Inputs:
        """What a log of that machine drives the plant with."""
        plant, K = self.plant, len(self.time_s)
        ambient = np.full((K, len(plant.known_names)), self.config.ambient.temperature_degC)
        y, m = self.measured(seed, noise_K), self.heat_W.shape[1]
        return Inputs(
            time_s=self.time_s,
            dt_s=np.diff(self.time_s, prepend=self.time_s[0]),
            y_degC=y,
            usable=np.ones(y.shape, dtype=bool),
            quality=np.zeros(y.shape, dtype=np.int8),
            law_W=np.zeros((K, m)),
            law_jump_W=np.zeros((K, m)),
            z_start=ambient,
            z_end=ambient,
            moving_B=np.zeros((K, 0, len(plant.decay_1_s))),
            moving_C=np.zeros((K, 0, len(plant.rows.C))),
            degraded=np.zeros(K, dtype=bool),
        )


def li_case(steps: int = 1000, step_s: float = 6.0, modes: int = 8) -> HeatCase:
    """An hour of running, 40 min of cooling: the nut's heat peaks at the start and decays, as Li finds it."""
    bar = Bar(0.6, 0.032, 45.0, 7850.0, 475.0, 12.0)
    mesh = Mesh(bar.length_m, CELLS)
    time_s = step_s * np.arange(steps + 1)
    middle_s = time_s[1:] - step_s / 2
    running = time_s[1:] <= 0.6 * time_s[-1]
    heats = [
        np.where(running, base * (1.0 + peak * np.exp(-middle_s / tau)), 0.0)
        for base, peak, tau in ((25.0, 0.8, 600.0), (6.0, 0.5, 900.0), (9.0, 0.5, 900.0))
    ]
    shares = (band_share(mesh, 0.09, 0.51), point_share(mesh, 0.0), point_share(mesh, 0.6))
    ends = (None, "left", "right")
    walk = {"initial_sigma_W": 30.0, "random_walk_W_sqrt_s": 0.3}
    sources: list[dict[str, Any]] = [
        {"name": "nut", "shape": "band", "from_m": 0.09, "to_m": 0.51, **walk},
        {"name": "support", "shape": "point", "position_m": 0.0, **walk},
        {"name": "motor", "shape": "point", "position_m": 0.6, **walk},
    ]
    sensor_m = (0.03, 0.2, 0.4, 0.57)
    truth = simulate(
        bar, mesh, time_s,
        [Heat(share, q, end) for share, q, end in zip(shares, heats, ends, strict=True)], np.array(sensor_m),
        ambient_degC=25.0, initial_degC=25.0,
    )  # fmt: skip
    return _case(bar, sources, sensor_m, truth.time_s, heats, truth.temperature_degC[:, :, 0], step_s, modes)


SPINDLE = Bar(0.8, 0.07, 44.5, 7850.0, 475.0, 20.0)
FRONT_M, REAR_M = 0.25, 0.6
NEAR_M, FAR_M = (0.25, 0.6), (0.7, 0.8)


def lathe_case(sensor_m: tuple[float, ...], steps: int = 240, step_s: float = 60.0) -> HeatCase:
    """Lathe's study as a rod: two bearings of 100 and 180 W that fall to 50 and 90 W half-way."""
    mesh = Mesh(SPINDLE.length_m, CELLS)
    time_s = step_s * np.arange(steps + 1)
    early = np.arange(steps) < steps // 2
    heats = [np.where(early, first, second) for first, second in ((100.0, 50.0), (180.0, 90.0))]
    sources = [
        {
            "name": name,
            "shape": "point",
            "position_m": x,
            "initial_sigma_W": 150.0,
            "random_walk_W_sqrt_s": 1.0,
        }
        for name, x in (("front", FRONT_M), ("rear", REAR_M))
    ]
    truth = simulate(
        SPINDLE, mesh, time_s,
        [Heat(point_share(mesh, x), q) for x, q in zip((FRONT_M, REAR_M), heats, strict=True)],
        np.array(sensor_m), ambient_degC=25.0, initial_degC=25.0,
    )  # fmt: skip
    return _case(SPINDLE, sources, sensor_m, time_s, heats, truth.temperature_degC[:, :, 0], step_s, modes=20)


def _case(
    bar: Bar, sources: list[dict[str, Any]], sensor_m: tuple[float, ...], time_s: FloatArray,
    heats: list[FloatArray], temperature_degC: FloatArray, step_s: float, modes: int,
) -> HeatCase:  # fmt: skip
    config = config_of(
        bar, sources, [0.0, bar.length_m], sensor_m=sensor_m, ambient={"temperature_degC": 25.0},
        model={"modes": modes}, estimator={"period_s": step_s, "field_noise_K_sqrt_s": 0.0},
    )  # fmt: skip
    sensors = tuple(s.model_copy(update={"noise_K": 0.1}) for s in config.sensor)
    heat_W = np.column_stack(heats)
    return HeatCase(
        config.model_copy(update={"sensor": sensors}),
        time_s,
        np.vstack([heat_W[:1], heat_W]),
        temperature_degC,
    )
