"""Screws with sections of their own diameter and bore, drawn and simulated by finite volumes."""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from observer import installation
from observer.config.machine import Config
from observer.files.logs import Log
from observer.frames import FloatArray
from observer.installation import parse
from tests.reference.service_path import log_of, open_loop
from tests.truth.bar import Mesh, band_share, nut_share, shuttle_m, substep_times
from tests.truth.machine.exchange import rotating_film_W_m2K
from tests.truth.series import measured
from tests.truth.stepped import CONDUCTIVITY_W_MK, SteppedBar, simulate

CELLS, STEP_s, END_s, AIR_degC, EXPANSION_1_K = 400, 2.0, 3600.0, 20.0, 11.8e-6


class Drawn(NamedTuple):
    """A screw, its truth's mesh, its film at rest and in motion, and what heats it."""

    config: Config
    bar: SteppedBar
    turning_W_m2K: float


SPEED_rpm = 1200.0


def drawn(seed: int) -> Drawn:
    """A screw of one to four sections at whole cells, with films at its ends in half of all cases, and a
    speed that adds to its film in half of all.
    """
    rng = np.random.default_rng(seed)
    length_m, d_m = rng.uniform(0.4, 1.6), rng.uniform(0.016, 0.06)
    bore_m = float(rng.choice([0.0, rng.uniform(0.2, 0.5) * d_m]))
    mesh = Mesh(length_m, CELLS)
    outer, inner = np.full(CELLS, d_m), np.full(CELLS, bore_m)
    at = np.sort(rng.choice(np.arange(4, CELLS // 8) * 8, 2 * int(rng.integers(1, 5)), replace=False))
    at[0] = 0 if rng.random() < 0.7 else at[0]
    at[-1] = CELLS if rng.random() < 0.7 else at[-1]
    sections = []
    for first, last in at.reshape(-1, 2).tolist():
        own_m = rng.uniform(0.6, 1.4) * d_m
        own = {"from_m": mesh.edges_m[first], "to_m": mesh.edges_m[last], "diameter_m": own_m}
        if rng.random() < 0.6 or bore_m >= own_m:
            own["bore_m"] = float(rng.choice([0.0, rng.uniform(0.2, 0.8) * own_m]))
        outer[first:last], inner[first:last] = own_m, own.get("bore_m", bore_m)
        sections.append(own)
    ends = rng.uniform(20.0, 300.0, 2) if rng.random() < 0.5 else np.zeros(2)
    film, gain = rng.uniform(5.0, 40.0), float(rng.choice([0.0, rng.uniform(0.2, 1.0)]))
    nut_m, low_m, high_m = 0.08 * length_m, 0.2 * length_m, 0.8 * length_m
    heated = {"speed_channel": "speed_rpm"}
    table: dict[str, Any] = {
        "screw": {
            "length_m": length_m, "diameter_m": d_m, "bore_m": bore_m, "conductivity_W_mK": CONDUCTIVITY_W_MK,
            "density_kg_m3": 7800.0, "specific_heat_J_kgK": 460.0, "expansion_1_K": EXPANSION_1_K,
            "section": sections,
        },
        "surface": {"convection_W_m2K": film},
        "ambient": {"temperature_degC": AIR_degC},
        "boundary": {
            side: {"kind": "convective", "coefficient_W_m2K": h}
            for side, h in zip(("left", "right"), ends, strict=True)
            if h
        },
        "source": [
            {"name": "nut", "shape": "nut", "length_m": nut_m, "stroke_m": [low_m, high_m],
             "position_channel": "nut_m", "heat_W_rpm": 0.02, **heated},
            {"name": "bearing", "shape": "band", "from_m": 0.0, "to_m": 0.04 * length_m, "heat_W_rpm": 0.008,
             **heated},
        ],
        "sensor": [{"name": "t1", "channel": "t1_degC", "position_m": 0.5 * length_m}],
        # what fewer leave out near a nut that passes is the same as of a uniform screw
        "model": {"modes": 80},
        "effect": [{"kind": "speed_convection", "gain": gain}] if gain else [],
        "output": {"positions_m": mesh.edges_m[4:-3:8].tolist(), "reference_degC": AIR_degC},
    }  # fmt: skip
    bar = SteppedBar(mesh, outer, inner, (float(ends[0]), float(ends[1])))
    return Drawn(parse(table), bar, gain * rotating_film_W_m2K.py_func(SPEED_rpm, d_m))


class Seen(NamedTuple):
    """Temperatures, °C, and errors, µm, (K, g), by the truth and by the model."""

    degC: FloatArray
    model_degC: FloatArray
    um: FloatArray
    model_um: FloatArray


def seen(case: Drawn) -> Seen:
    """Forty minutes of a nut that runs to and fro, then twenty of rest."""
    mesh, screw = case.bar.mesh, case.config.screw
    time_s = STEP_s * np.arange(round(END_s / STEP_s) + 1)
    runs = time_s < 2400.0
    share = 0.5 * (runs[1:].astype(float) + runs[:-1])  # of a step in which it runs, as the log shows it
    runs_s, speed_m_s = np.minimum(substep_times(time_s, 10), 2400.0), 0.02 * screw.length_m
    low_m, high_m = 0.2 * screw.length_m, 0.8 * screw.length_m
    path_m = shuttle_m(runs_s, low_m, high_m, speed_m_s)
    source = case.config.source
    heats = [
        (nut_share(mesh, source[0].length_m or 0.0, path_m), 0.02 * SPEED_rpm * share),
        (band_share(mesh, 0.0, source[1].to_m or 0.0), 0.008 * SPEED_rpm * share),
    ]
    film_W_m2K = case.config.surface.convection_W_m2K + case.turning_W_m2K * share
    field = simulate(case.bar, time_s, heats, film_W_m2K, AIR_degC)
    log = log_of(
        time_s,
        {
            "t1_degC": np.full(len(time_s), AIR_degC),
            "nut_m": shuttle_m(np.minimum(time_s, 2400.0), low_m, high_m, speed_m_s),
            "speed_rpm": np.where(runs, SPEED_rpm, 0.0),
        },
    )
    plant, rows = open_loop(case.config, log, AIR_degC)
    face = np.arange(4, CELLS - 3, 8)
    grown_m = np.cumsum(field - AIR_degC, axis=1)[:, face - 1] * mesh.width_m
    return Seen(
        case.bar.at_faces(field)[:, face - 1], rows[:, plant.rows.field_slice],
        1e6 * EXPANSION_1_K * grown_m, rows[:, plant.rows.error_slice],
    )  # fmt: skip


SLIDES = Path(__file__).parents[2] / "config" / "stepped-screw.toml"
SLIDES_AIR_degC, SLIDES_END_s, SLIDES_CELLS = 22.0, 5400.0, 480
SLIDES_rpm = 600.0
SLIDES_LAW_W = SLIDES_rpm * np.array([0.21 * np.pi / 30.0, 0.15 * np.pi / 30.0, 0.006, 0.003])


class Slides(NamedTuple):
    """A log of the screw with two nuts, the true heats (m,) in W as long as it turns, and its true field and
    error on the grid at the last row of that, (g,).
    """

    config: Config
    log: Log
    heat_W: FloatArray
    turns: FloatArray
    field_degC: FloatArray
    error_um: FloatArray


def two_slides(seed: int) -> Slides:
    """An hour and a quarter at 600 rpm, a row a second, then rest: four heats, up to half off their laws."""
    rng, config = np.random.default_rng(seed), installation.load(SLIDES)
    screw, mesh = config.screw, Mesh(config.screw.length_m, SLIDES_CELLS)
    centres = mesh.centres_m
    own = [next(p for p in screw.pieces if x < p.to_m) for x in centres.tolist()]
    bar = SteppedBar(mesh, np.array([p.diameter_m for p in own]), np.array([p.bore_m for p in own]))
    time_s = np.arange(SLIDES_END_s + 1.0)
    turns = time_s < 0.833 * SLIDES_END_s
    heat_W = SLIDES_LAW_W * rng.uniform(0.5, 1.5, 4)
    paths, heats = {}, []
    for source, W in zip(config.source, heat_W.tolist(), strict=True):
        if source.stroke_m is None:
            share = band_share(mesh, source.from_m or 0.0, source.to_m or 0.0)
        else:
            low_m, high_m = source.stroke_m
            speed_m_s = SLIDES_rpm / 60.0 * (source.lead_m or 0.0)
            way_s = np.minimum(substep_times(time_s, 10), time_s[turns][-1])
            share = nut_share(mesh, source.length_m or 0.0, shuttle_m(way_s, low_m, high_m, speed_m_s))
            paths[str(source.position_channel)] = shuttle_m(
                np.minimum(time_s, time_s[turns][-1]), low_m, high_m, speed_m_s
            )
        heats.append((share, W * turns[1:]))
    film = np.full(len(time_s) - 1, config.surface.convection_W_m2K)
    field = simulate(bar, time_s, heats, film, SLIDES_AIR_degC)
    columns = {
        sensor.channel: measured(
            np.array([np.interp(sensor.position_m or 0.0, centres, row) for row in field]), 0.1, rng, 0.01
        )
        for sensor in config.sensor
    }
    log = log_of(time_s, columns | paths | {"screw_speed_rpm": np.where(turns, SLIDES_rpm, 0.0)})
    last, grid_m = int(turns.sum()) - 1, np.linspace(0.0, screw.length_m, 21)
    grown_um = 1e6 * EXPANSION_1_K * np.append(0.0, np.cumsum(field[last] - SLIDES_AIR_degC)) * mesh.width_m
    return Slides(
        config, log, heat_W, turns, np.interp(grid_m, centres, field[last]),
        np.interp(grid_m, mesh.edges_m, grown_um),
    )  # fmt: skip


def with_true_heats(this: Slides) -> Config:
    """The configuration with the heats of the truth as its laws."""
    sources = [
        source.model_copy(update={"scale": float(heat_W / law_W)})
        for source, heat_W, law_W in zip(this.config.source, this.heat_W, SLIDES_LAW_W, strict=True)
    ]
    return this.config.model_copy(update={"source": tuple(sources)})
