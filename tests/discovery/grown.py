"""Cases of the independent machine with probes: what its screw grows, and what moves the axis beside heat."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np

from tests.logs.machines import probe
from tests.truth.machine.cycles import RUNS, STEP_s
from tests.truth.machine.generate import Case, logged, machine_of, trace
from tests.truth.machine.logs import FORMATS, configuration, write_log
from tests.truth.machine.machine import stream
from tests.truth.machine.physics import FloatArray
from tests.truth.machine.run import run_machine

EXPANSION_1_K, FINE_M = 11.8e-6, np.linspace(0.0, 1.0, 201)
PLACES_M, NOISE_UM, ZERO_UM = (0.5, 0.9), 0.5, 2.0


class Moved(NamedTuple):
    """What moves the axis and warms nothing: by how much more the screw expands, relative; the expansion of a
    bed that is as warm as the air, 1/K; a drift of the first probe, µm/h; a knock on it half-way, µm.
    """

    expansion: float = 0.0
    bed_1_K: float = 0.0
    drift_um_h: float = 0.0
    knock_um: float = 0.0


def write_grown(case: Case, moved: Moved, folder: Path, every_s: float = 10.0) -> list[Path]:
    """Write logs and configuration of a case with two probes that are read `every_s`; return the logs.

    Each log has zeros of its own.
    """
    folder.mkdir(parents=True, exist_ok=True)
    machine, paths = machine_of(case), []
    names = [f"probe_{1000 * x:.0f}_um" for x in PLACES_M]
    for run in RUNS[: case.logs]:
        traced = trace(case, run, machine)
        own = logged(case, run, traced)
        scene, rng = traced.scene, stream(case.seed, case.name, run, "probe")
        fine = run_machine(scene.machine.physics, scene.schedule, FINE_M).section_degC
        readings = np.full((len(own.time_s), len(PLACES_M)), np.nan)
        rows = np.flatnonzero(np.diff(np.floor(own.time_s / every_s), prepend=-1.0) > 0)
        for j, x_m in enumerate(PLACES_M):
            true_um = _axis_um(own.time_s[rows], fine, traced.air_degC, x_m, moved, first=j == 0)
            noise_um = NOISE_UM * rng.standard_normal(len(rows)) + ZERO_UM * rng.standard_normal()
            readings[rows, j] = np.round(true_um + noise_um, 1)
        paths.append(folder / f"run_{run}.csv.gz")
        write_log(
            paths[-1], own.time_s, np.column_stack([own.values, readings]),
            FORMATS | dict.fromkeys(names, "%.1f"),
        )  # fmt: skip
    text = configuration(case.unmodelled, known=not case.rough)
    occasional = every_s > 60.0
    for x_m in PLACES_M:
        text += probe(f"probe_{1000 * x_m:.0f}", x_m, NOISE_UM, ZERO_UM, occasional=occasional)
    (folder / "config.toml").write_text(text, encoding="utf-8")
    return paths


def _axis_um(
    time_s: FloatArray, fine: FloatArray, air_degC: FloatArray, x_m: float, moved: Moved, *, first: bool
) -> FloatArray:
    """How far the axis has moved at a place, from where the screw is as warm as the first air."""
    inside = np.where(x_m + 1e-9 >= FINE_M, FINE_M, 0.0)
    upto = x_m + 1e-9 >= FINE_M
    grown_um = (
        1e6
        * EXPANSION_1_K
        * (1.0 + moved.expansion)
        * np.trapezoid(fine[:, upto] - air_degC[0], inside[upto], axis=1)
    )
    bed_um = 1e6 * moved.bed_1_K * x_m * (air_degC - air_degC[0])
    whole = np.interp(time_s, np.arange(len(fine)) * STEP_s, grown_um - bed_um)
    if first:
        whole = whole + moved.drift_um_h * time_s / 3600.0 + moved.knock_um * (time_s > 0.5 * time_s[-1])
    return np.asarray(whole)
