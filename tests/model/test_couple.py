"""What a plant of few modes reads under its sources is what one of many has there."""

from __future__ import annotations

import numpy as np
import pytest

from observer.kernels.coupling import see_under
from observer.model.build import build_plant
from observer.model.plant import Plant
from observer.model.rod.screw import surface_rate
from tests.bits.shared import COUPLINGS
from tests.logs.plants import described
from tests.model.unturned import unturned

FADING = [{"kind": "friction_fade", "target": name, "per_K": 0.01} for name in ("nut", "left")]
AIR_DEGC = 30.0


def plant_of(modes: int) -> Plant:
    """A nut over its stroke, a bearing at an end and one that does not fade."""
    config, _ = described(modes, 3, 3, effect=FADING)
    return unturned(config)[0]


def under_at_rest(plant: Plant, law_W: np.ndarray) -> np.ndarray:
    """The temperature under each source where heats and air have been the same for very long, °C."""
    z = np.where(np.array(plant.known_names) == "ambient", AIR_DEGC, 0.0)
    x = (plant.B @ law_W + plant.E @ z) / plant.decay_1_s
    B, link, found = np.ascontiguousarray(plant.B.T), np.zeros((3, len(x))), []
    for source in range(len(law_W)):
        see_under(plant.coupling, source, B, link)
        found.append(link[0] @ x + plant.coupling.under_F[source] @ z)
    return np.array(found)


@pytest.mark.parametrize("law_W", [(0.0, 0.0, 0.0), (50.0, 0.0, 0.0), (0.0, 20.0, 0.0), (30.0, 10.0, 5.0)])
def test_what_the_dropped_modes_hold_under_a_source_is_read(law_W: tuple[float, ...]) -> None:
    few, many = (under_at_rest(plant_of(modes), np.array(law_W)) for modes in (3, 60))
    np.testing.assert_allclose(few[:2], many[:2], rtol=0, atol=0.01 * (few[:2].max() - AIR_DEGC) + 1e-6)
    if not any(law_W):
        np.testing.assert_allclose(few, AIR_DEGC, rtol=1e-9)


def test_the_mean_of_a_screw_is_that_of_its_field() -> None:
    plant = plant_of(3)
    assert plant.coupling.mean @ plant.uniform == pytest.approx(1.0)
    assert plant.coupling.mean[1:] == pytest.approx(0.0, abs=1e-12), (
        "a wave of an insulated screw has no mean"
    )


def test_at_rest_bodies_and_sensors_that_lag_have_the_temperature_about_them() -> None:
    """A screw held at one end, a body that loses heat at the other, and air as warm as the end."""
    body = [effect | {"target": "right"} for effect in COUPLINGS["body_at_an_end"]]
    bias = {"kind": "sensor_bias", "target": "t2", "offset_K": 0.3}
    ends = {"left": {"kind": "prescribed", "channel": "left_degC"}}
    config, _ = described(3, 3, 3, effect=[*body, *COUPLINGS["lags"], bias], boundary=ends)
    plant = build_plant(config)
    assert not plant.coupling.active, "nothing of it goes with the moment"
    known = {"ambient": AIR_DEGC, "left": AIR_DEGC, "offset.t2": 0.3}
    z = np.array([known.get(name, 0.0) for name in plant.known_names])
    x = plant.E @ z / plant.decay_1_s
    read = plant.rows.C @ x + plant.rows.F @ z
    np.testing.assert_allclose(read - [0.0, 0.3, 0.0, *[0.0] * 3], AIR_DEGC, rtol=1e-6)


def test_a_film_along_a_stretch_takes_its_part_of_an_even_field() -> None:
    film = {"kind": "uneven_convection", "from_m": 0.1, "to_m": 0.35, "extra_W_m2K": 40.0}
    config, _ = described(6, 3, 3, effect=[film])
    plant, constant, *_ = unturned(config)
    rate_1_s = 40.0 * surface_rate(config.screw) * 0.25
    mean = np.zeros(len(plant.uniform))
    mean[0] = 1.0 / plant.uniform[0]  # a wave of an insulated screw has no mean
    assert mean @ constant.A @ plant.uniform == pytest.approx(-rate_1_s, rel=1e-9)
    assert mean @ constant.E[:, plant.known.ambient] == pytest.approx(rate_1_s, rel=1e-9)
