"""A forecast is computed in a thread of its own, and the ticks beside it come in time."""

from __future__ import annotations

import threading

import numpy as np
import pytest

from campaigns.forecast.beside import PERIOD_S, ticks

pytestmark = [pytest.mark.system, pytest.mark.slow]


def test_ticks_with_a_forecast_beside_them_come_in_time() -> None:
    found = ticks(16.0)
    assert found.forecasts.thread
    assert threading.get_ident() not in found.forecasts.thread
    assert min(len(found.beside_s), len(found.alone_s)) >= 5
    # In the service threads hand over every 1 ms, and a tick takes the interpreter back a few times. Half a
    # period is far more, and far less than a forecast that a tick waits for.
    assert np.median(found.beside_s) - np.median(found.alone_s) < 0.5 * PERIOD_S
