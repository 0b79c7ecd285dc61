"""A screw with bearings in housings and a nut on a table, described twice: for truth and product."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np

from observer.config.machine import Config
from observer.files.logs import Log
from tests.reference.cases import config_of
from tests.reference.service_path import log_of
from tests.truth import nodes
from tests.truth.bar import (
    Bar,
    FloatArray,
    Mesh,
    band_share,
    nut_share,
    shuttle_m,
    substep_times,
    waiting_shuttle_m,
)

BAR, MESH = Bar(length_m=0.6, diameter_m=0.032, convection_W_m2K=12.0), Mesh(0.6, 120)
LOW_M, HIGH_M, NUT_M = 0.12, 0.48, 0.08
GRID_M = MESH.centres_m[::10]
NAMES = ("left_ring", "left_housing", "right_ring", "right_housing", "nut_body", "table")
CAPACITY_J_K = (120.0, 2500.0, 90.0, 1800.0, 600.0, 9000.0)
LINKS = (("left_ring", "left_housing", 4.0), ("right_ring", "right_housing", 3.0), ("nut_body", "table", 1.5))
TO_AIR = (("left_housing", 0.8), ("right_housing", 0.6), ("nut_body", 0.3), ("table", 4.0))
CONTACTS = (("left_ring", "left", 3.0), ("right_ring", "right", 2.5), ("nut_body", "nut", 2.0))
INTO_BODY = 0.5
"""Part of every heat that goes into ring or nut, not into the screw."""
AMBIENT_DEGC = 20.0
NOMINAL_W = {"nut": 40.0, "left": 16.0, "right": 11.0}
FULL_RPM = 1000.0


@dataclass(frozen=True, slots=True)
class Case:
    """The truth: times (K + 1,), field on the grid (K + 1, g), bodies (K + 1, n) and heats (K, 3)."""

    time_s: FloatArray
    field_degC: FloatArray
    body_degC: FloatArray
    heat_W: FloatArray

    def log(self, sensors: dict[str, FloatArray], noise_K: float, position_m: FloatArray | None) -> Log:
        """The log of sensors, with white noise; seed fixed."""
        rng = np.random.default_rng(11)
        columns = {name: value + noise_K * rng.standard_normal(len(value)) for name, value in sensors.items()}
        for j, name in enumerate(NOMINAL_W):
            columns[f"{name}_W"] = np.append(self.heat_W[0, j], self.heat_W[:, j])
        columns["speed_rpm"] = np.append(0.0, FULL_RPM * running(self.time_s))
        if position_m is not None:
            columns["nut_position_m"] = position_m
        return log_of(self.time_s, columns)


def running(time_s: FloatArray) -> FloatArray:
    """Speed over each step, (K,), as a part of the full one: full, a pause, slower."""
    middle = 0.5 * (time_s[1:] + time_s[:-1]) / time_s[-1]
    return np.where(middle < 0.5, 1.0, np.where(middle < 0.6, 0.0, 0.6))


def heats(time_s: FloatArray) -> FloatArray:
    """Nut, left and right bearing (K, 3), W: in proportion to speed, 40 % more at the start, which fades."""
    peak = 1.0 + 0.4 * np.exp(-0.5 * (time_s[1:] + time_s[:-1]) / 600.0)
    return np.asarray((running(time_s) * peak)[:, None] * np.array([*NOMINAL_W.values()]))


@cache
def case(
    speed_m_s: float | None,
    end_s: float = 3600.0,
    step_s: float = 1.0,
    *,
    covers: bool = False,
    waits: bool = False,
) -> tuple[Case, FloatArray | None]:
    """The truth, and the nut's position (K + 1,); without a speed the nut is spread over its stroke.

    If it `covers`, no air cools the screw where it is; if it `waits`, it stands at one end four times as long
    as at the other, and takes half a minute in between.
    """
    time_s = step_s * np.arange(round(end_s / step_s) + 1)
    heat_W = heats(time_s)
    if speed_m_s is None:
        under, position_m = band_share(MESH, LOW_M, HIGH_M), None
    else:

        def nut_at(t_s: FloatArray) -> FloatArray:
            if waits:
                return waiting_shuttle_m(t_s, LOW_M, HIGH_M, 30.0, 15.0, 60.0)
            return shuttle_m(t_s, LOW_M, HIGH_M, speed_m_s)

        under, position_m = nut_share(MESH, NUT_M, nut_at(substep_times(time_s, 10))), nut_at(time_s)
    index = NAMES.index
    ends: dict[str, Any] = {"left": {"end": "left"}, "right": {"end": "right"}, "nut": {"share": under}}
    bodies = nodes.Bodies(
        np.array(CAPACITY_J_K),
        [(index(a), index(b), G) for a, b, G in LINKS],
        [(index(a), G) for a, G in TO_AIR],
        [nodes.Contact(index(a), G, **ends[at]) for a, at, G in CONTACTS],
    )
    warm = []
    for j, (name, body) in enumerate((("nut", "nut_body"), ("left", "left_ring"), ("right", "right_ring"))):
        warm.append(nodes.Heat((1 - INTO_BODY) * heat_W[:, j], **ends[name]))
        warm.append(nodes.Heat(INTO_BODY * heat_W[:, j], body=index(body)))
    covered = np.broadcast_to(under * (NUT_M / MESH.width_m), (len(heat_W), MESH.cells)) if covers else None
    field, body = nodes.simulate(BAR, MESH, bodies, warm, time_s, AMBIENT_DEGC, covered)
    return Case(time_s, field[:, ::10], body, heat_W), position_m


def measured_power() -> dict[str, dict[str, Any]]:
    """Laws by which every heat is measured."""
    return {name: {"power_channel": f"{name}_W"} for name in NOMINAL_W}


def by_speed(scale: float) -> dict[str, dict[str, Any]]:
    """Laws of the speed that know nothing of the peak, and are wrong by a factor on top."""
    keys = {"speed_channel": "speed_rpm", "law_uncertainty": 0.4, "random_walk_W_sqrt_s": 0.15}
    return {n: {"heat_W_rpm": scale * heat_W / FULL_RPM} | keys for n, heat_W in NOMINAL_W.items()}


def config(
    moving: bool, sensors: list[dict[str, Any]], laws: dict[str, dict[str, Any]], *, covers: bool = False
) -> Config:
    """The same machine as a configuration."""
    into = {"nut": "nut_body", "left": "left_ring", "right": "right_ring"}
    nut: dict[str, Any] = {"name": "nut", "shape": "nut", "length_m": NUT_M, "stroke_m": [LOW_M, HIGH_M]}
    nut |= {"covers_film": covers}
    if moving:
        nut["position_channel"] = "nut_position_m"
    ends = [{"name": n, "shape": "point", "position_m": x} for n, x in (("left", 0.0), ("right", 0.6))]
    sources = [s | {"nodes": {into[s["name"]]: INTO_BODY}} | laws[s["name"]] for s in (nut, *ends)]
    links = [{"between": [a, b], "conductance_W_K": G} for a, b, G in (*LINKS, *CONTACTS)]
    links += [{"between": [a, "ambient"], "conductance_W_K": G} for a, G in TO_AIR]
    return config_of(
        BAR,
        sources,
        GRID_M,
        node=[{"name": n, "capacity_J_K": C} for n, C in zip(NAMES, CAPACITY_J_K, strict=True)],
        link=links,
        sensor=sensors,
        ambient={"temperature_degC": AMBIENT_DEGC},
        estimator={"period_s": 1.0},
    )


def on_nodes(noise_K: float, names: tuple[str, ...] = NAMES) -> list[dict[str, Any]]:
    """A sensor on each of some nodes."""
    return [{"name": n, "channel": f"{n}_degC", "on": n, "noise_K": noise_K} for n in names]
