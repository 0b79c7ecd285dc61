"""Sensors that show a part of the rise above the air: an infrared sensor on steel, a sliding contact."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from observer.config.machine import Config
from observer.errors import UserError
from observer.fit.calibrate import calibrate
from observer.fit.parameters import with_values
from observer.fit.tolerance import learnt_changes
from observer.frames import FloatArray
from observer.installation import parse
from observer.model.build import build_plant
from observer.model.learning import Nuisance
from observer.model.simulate import simulate, start
from tests.logs.inputs import driven
from tests.logs.machines import table
from tests.logs.plants import described
from tests.logs.simulated import made_log

SHOWS = 0.3
LAG: list[dict[str, Any]] = [{"kind": "sensor_lag", "target": "t2", "time_constant_s": 40.0}]
BIAS = [{"kind": "sensor_bias", "target": "t2", "offset_K": 0.4}]
BESIDE = {
    "node": [{"name": "housing", "capacity_J_K": 500.0}],
    "link": [
        {"between": ["housing", "left"], "conductance_W_K": 5.0},
        {"between": ["housing", "ambient"], "conductance_W_K": 1.0},
    ],
}


def readings(shows: float, place: dict[str, Any], **tables: Any) -> tuple[FloatArray, ...]:
    """The air (K,), what sensor t2 reads too much (K,), and what it reads (K,), open loop, of a screw with a
    nut that moves.
    """
    sensors: list[dict[str, Any]] = [
        {"name": "t1", "channel": "t1_degC", "position_m": 0.1},
        {"name": "t2", "channel": "t2_degC", "shows": shows} | place,
    ]
    _, plant = described(4, 2, 3, moving=True, sensor=sensors, **tables)
    u = driven(plant, 300, dt_s=2.0)
    rows = simulate(plant, start(plant, 30.0, u.law_W[0]), u)[1]
    too_much_K = u.z_end[:, plant.known.offset].sum(axis=1)
    return u.z_end[:, plant.known.ambient], too_much_K, rows[:, 1]


@pytest.mark.parametrize(
    ("place", "tables"),
    [
        ({"position_m": 0.5}, {}),
        ({"position_m": 0.5}, {"effect": BIAS}),
        ({"on": "housing"}, BESIDE),
    ],
    ids=["under the nut", "with an offset", "on a node"],
)
def test_it_reads_so_much_of_the_rise_and_the_air_for_the_rest(
    place: dict[str, Any], tables: dict[str, Any]
) -> None:
    air_degC, own_K, whole = readings(1.0, place, **tables)
    expected = air_degC + SHOWS * (whole - own_K - air_degC) + own_K
    np.testing.assert_allclose(readings(SHOWS, place, **tables)[-1], expected, atol=1e-9)
    assert np.ptp(whole) > 1.0
    assert own_K.any() == ("effect" in tables)


def test_its_lag_is_that_of_the_whole_sensor() -> None:
    """Under air that stays, a first-order lag of a part is the part of the lag, once the start is over."""
    air = {"ambient": {"channel": "air_degC"}, "effect": LAG}
    air_degC, _, whole = readings(1.0, {"position_m": 0.5}, **air)
    *_, part = readings(SHOWS, {"position_m": 0.5}, **air)
    rises_K_s = np.diff(air_degC).max() / 2.0
    late_K = LAG[0]["time_constant_s"] * rises_K_s  # how far it is behind an air that rises evenly
    off_K = (part - (air_degC + SHOWS * (whole - air_degC)))[200:]
    np.testing.assert_allclose(off_K, -(1.0 - SHOWS) * late_K, atol=1e-3)
    assert np.ptp(whole[200:]) > 0.3


def looking(**keys: Any) -> Config:
    """A bar with an infrared sensor in its middle."""
    own = {
        "name": "b",
        "channel": "b_degC",
        "position_m": 0.2,
        "noise_K": 0.05,
        "shows": 0.4,
        "offset_K": 0.0,
    }
    made = table()
    made["sensor"][1] = own | keys
    return parse(made)


def test_the_unknown_part_changes_the_reading_as_the_configuration_does() -> None:
    config = looking(shows_tolerance=0.2)
    plant = build_plant(config, learns=True)
    a = plant.parameters
    (q,) = np.flatnonzero(a.kind == Nuisance.GAIN)
    assert (plant.learning is not None, a.of[q], a.sigma[q]) == (True, 1, 0.2)
    x = np.random.default_rng(1).normal(size=len(plant.decay_1_s))
    z = np.full(len(plant.known_names), 20.0)
    more = build_plant(with_values(config, {"sensor.b.shows": 0.4 * 1.1})).rows
    change = (more.C[1] - plant.rows.C[1]) @ x + (more.F[1] - plant.rows.F[1]) @ z
    assert a.entries(x, z)[q] == pytest.approx(change / 0.1, rel=1e-9)


def test_a_calibration_finds_it() -> None:
    """The other two sensors know how warm the bar is."""
    truth = looking(shows=0.31)
    config = looking(shows_tolerance=0.2)
    free = {"free": ["surface.convection_W_m2K", "sensor.b.shows"]}
    config = config.remade(config.model_dump(exclude_unset=True, by_alias=True) | {"calibrate": free})
    found = calibrate(config, [[made_log(truth, 1)]])
    (own,) = [f for f in found.fitted if f.key == "sensor.b.shows"]
    assert own.ci95[0] <= 0.31 <= own.ci95[1]
    assert own.ci95[1] - own.ci95[0] < 0.02
    assert 0.0 < found.left["sensor.b.shows_tolerance"] < 0.03


def test_what_was_learnt_of_it_can_be_adopted() -> None:
    changes = learnt_changes(looking(shows_tolerance=0.2), {"sensor.b.shows": (0.33, 0.0066)})
    assert changes.values == {"sensor.b.shows": 0.33}
    assert changes.left["sensor.b.shows_tolerance"] == pytest.approx(0.02)


@pytest.mark.parametrize("shows", [0.0, 2.5])
def test_a_part_out_of_reason_is_refused(shows: float) -> None:
    with pytest.raises(UserError, match=r"part of a rise|greater than 0"):
        looking(shows=shows)


def test_a_displacement_shows_no_part() -> None:
    made = table(screw=table()["screw"] | {"expansion_1_K": 11.8e-6})
    probe = {"name": "p", "kind": "displacement", "channel": "p_um", "position_m": 0.3, "shows": 0.5}
    made["sensor"].append(probe)
    with pytest.raises(UserError, match="shows has no meaning"):
        parse(made)
