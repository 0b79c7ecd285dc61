"""The drawn screws against hand calculations."""

from __future__ import annotations

import numpy as np
import pytest

from tests.truth.drawn_screw import SLICES, draw, loss_W


def test_a_still_air_film_doubles_at_sixteen_times_the_rise() -> None:
    """Its loss goes with the rise to the power of 5/4."""
    screw = draw(1, "still_air")
    small_W, large_W = (loss_W(screw, np.full(SLICES, rise_K), 0.0).sum() for rise_K in (2.0, 32.0))
    assert large_W == pytest.approx(16.0 * 2.0 * small_W)
    surface_W_K = screw.bar.film_W_mK * screw.bar.length_m
    assert loss_W(screw, np.full(SLICES, 20.0), 0.0).sum() == pytest.approx(20.0 * surface_W_K)


def test_other_losses_come_on_top_of_the_constant_film() -> None:
    rise_K = np.full(SLICES, 10.0)
    plain_W = loss_W(draw(1, "nothing"), rise_K, 500.0).sum()
    assert loss_W(draw(1, "end_conduction"), rise_K, 500.0).sum() == pytest.approx(plain_W + 0.15 * 10.0)
    assert loss_W(draw(1, "radiation"), rise_K, 500.0).sum() > plain_W
    turning_W, resting_W = (loss_W(draw(1, "speed_convection"), rise_K, rpm).sum() for rpm in (500.0, 0.0))
    assert turning_W > resting_W == pytest.approx(plain_W)
