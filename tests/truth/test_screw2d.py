"""The two-dimensional screw against what must hold of it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.truth import rod, screw2d
from tests.truth.bar import Bar, Mesh, band_share, nut_share, point_share, shuttle_m, substep_times
from tests.truth.rod import Heat
from tests.truth.series import measured, truth_columns, write_columns

MESH = Mesh(1.0, 125)
WHERE_M = np.array([0.05, 0.28, 0.5, 0.72, 0.95, 1.0])


def heats(time_s: np.ndarray) -> tuple[Heat, Heat]:
    count = len(time_s) - 1
    nut = Heat(
        nut_share(MESH, 0.08, shuttle_m(substep_times(time_s, 10), 0.2, 0.7, 0.4)), np.full(count, 40.0)
    )
    return nut, Heat(point_share(MESH, 0.0), np.full(count, 8.0), end="left")


def test_no_heat_is_lost_or_made_in_two_dimensions() -> None:
    bar, time_s = Bar(convection_W_m2K=0.0), np.linspace(0.0, 300.0, 301)
    nut, bearing = heats(time_s)
    run = screw2d.simulate(bar, MESH, time_s, [nut], [bearing], WHERE_M)
    stored = bar.capacity_J_mK * (run.integral_Km[-1, -1, 0] - run.integral_Km[0, -1, 0])
    assert stored == pytest.approx(48.0 * 300.0, rel=1e-9)


def test_the_section_mean_is_the_rod_at_a_small_biot_number() -> None:
    time_s = np.linspace(0.0, 1800.0, 1801)
    nut, bearing = heats(time_s)
    thick = screw2d.simulate(Bar(), MESH, time_s, [nut], [bearing], WHERE_M)
    thin = rod.simulate(Bar(), MESH, time_s, [nut, bearing], WHERE_M)
    difference = thick.temperature_degC - thin.temperature_degC
    # what the rod leaves out is the radial gradient: the surface is warmer than the section's mean under the
    # heated stretch and colder elsewhere, by h R/(4 k) = 0.13 % of a rise of 10 K, and more under the nut
    assert np.abs(difference).max() < 0.06
    assert np.abs(difference).max() > 1e-4  # two codes, not one


def test_a_uniform_surface_heat_settles_on_the_radial_parabola() -> None:
    bar = Bar(convection_W_m2K=20.0)
    time_s = np.arange(41) * 2000.0
    heat = Heat(band_share(MESH, 0.0, 1.0), np.full(40, 10.0))
    run = screw2d.simulate(bar, MESH, time_s, [heat], [], WHERE_M)
    # no gradient inside at rest: everything that enters the surface leaves through it
    assert run.temperature_degC[-1, :, 0] == pytest.approx(20.0 + 10.0 / (bar.film_W_mK * 1.0), abs=1e-3)


def test_the_truth_is_written_as_a_log(tmp_path: Path) -> None:
    time_s = np.linspace(0.0, 10.0, 11)
    nut, bearing = heats(time_s)
    run = screw2d.simulate(Bar(), MESH, time_s, [nut], [bearing], WHERE_M)
    rng = np.random.default_rng(3)
    shown = measured(run.temperature_degC[:, 0, 0], 0.05, rng, 0.01)
    shown[4] = np.nan
    path = write_columns(tmp_path / "log.csv", time_s, {"t1_degC": shown})
    lines = path.read_text().splitlines()
    assert lines[0] == "time_s,t1_degC"
    assert lines[5] == "4.0,"
    assert float(lines[-1].split(",")[1]) == shown[-1]
    columns = truth_columns(Bar(), run, {"nut": np.full(11, 40.0)}, 20.0)
    assert list(columns)[:3] == ["heat_nut_W", "field_50_degC", "field_280_degC"]
    assert columns["error_1000_um"][-1] > 0.0
