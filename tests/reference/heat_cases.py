"""Logs of known heats by the finite volumes: Li's axis, its nut moving or spread out; Lathe's spindle."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from observer.config.machine import Config
from observer.files.logs import Log
from observer.frames import FloatArray, Inputs
from observer.model.build import build_plant
from observer.model.plant import Plant
from tests.reference.cases import config_of
from tests.reference.service_path import log_of
from tests.truth.bar import Bar, Mesh, band_share, nut_share, point_share, shuttle_m, substep_times
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
            loss_1_s=np.zeros(K),
            loss_degC=np.zeros(K),
        )


def standing_case(steps: int = 1000, step_s: float = 6.0, modes: int = 8) -> HeatCase:
    """Li's axis with the nut's heat spread over the stroke, so that every method can take it."""
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


LI_STEP_S, LI_RUN_S, LI_END_S = 0.5, 3600.0, 6000.0
LI_CELLS = 150


@dataclass(frozen=True, slots=True)
class Experiment:
    """A log and the heats (K, m) behind it, mean over the step that ends at each row."""

    log: Log
    heat_W: FloatArray


def li_experiment(
    config: Config, traverse_m_s: float, seed: int, run_s: float = LI_RUN_S, end_s: float = LI_END_S
) -> Experiment:
    """Li's experiment on the axis of `config`: an hour to and fro, 40 min of standstill, 0.1 K of noise.

    The heats start above what the configuration's laws say, the nut's 80 % and the bearings' 50 %, and decay
    to them in ten minutes and a quarter of an hour.
    """
    screw, nut = config.screw, config.source[0]
    bar = Bar(
        screw.length_m, screw.diameter_m, screw.conductivity_W_mK, screw.density_kg_m3,
        screw.specific_heat_J_kgK, config.surface.convection_W_m2K,
    )  # fmt: skip
    mesh, time_s = Mesh(bar.length_m, LI_CELLS), np.arange(0.0, end_s + LI_STEP_S, LI_STEP_S)
    rpm = 60.0 * traverse_m_s / nut.lead_m
    middle_s = time_s[1:] - LI_STEP_S / 2
    laws_W = (
        nut.share * nut.torque_Nm * rpm * np.pi / 30.0,
        *(s.heat_W_rpm * rpm for s in config.source[1:]),
    )
    heats = [
        np.where(middle_s < run_s, law_W * (1.0 + peak * np.exp(-middle_s / tau_s)), 0.0)
        for law_W, peak, tau_s in zip(laws_W, (0.8, 0.5, 0.5), (600.0, 900.0, 900.0), strict=True)
    ]

    def nut_at(t_s: FloatArray) -> FloatArray:
        return shuttle_m(np.minimum(t_s, run_s), *nut.stroke_m, traverse_m_s)

    share = nut_share(mesh, nut.length_m, nut_at(substep_times(time_s, 10)))
    ends = [Heat(point_share(mesh, x), q, end) for x, q, end in zip(
        (0.0, bar.length_m), heats[1:], ("left", "right"), strict=True)]  # fmt: skip
    places = np.array([s.position_m for s in config.sensor])
    ambient = config.ambient.temperature_degC
    truth = simulate(
        bar, mesh, time_s, [Heat(share, heats[0]), *ends], places, ambient_degC=ambient, initial_degC=ambient
    )
    shown = truth.temperature_degC[:, :, 0]
    shown = shown + 0.1 * np.random.default_rng(seed).standard_normal(shown.shape)
    columns = {s.channel: shown[:, i] for i, s in enumerate(config.sensor)}
    columns |= {"nut_position_m": nut_at(time_s), "screw_speed_rpm": np.where(time_s < run_s, rpm, 0.0)}
    return Experiment(log_of(time_s, columns), np.vstack([[q[0] for q in heats], np.column_stack(heats)]))


SPINDLE = Bar(0.8, 0.07, 44.5, 7850.0, 475.0, 20.0)
FRONT_M, REAR_M = 0.25, 0.6
NEAR_M, MORE_M, FAR_M = (0.25, 0.6), (0.22, 0.25, 0.6, 0.63), (0.7, 0.8)


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
