"""What is refused of a log before anything is fitted to it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from observer.errors import LogError
from observer.fit.runs import prepare
from tests.logs.machines import machine
from tests.logs.simulated import made_log


@pytest.mark.parametrize("channel", ["heater_W", "n_rpm"])
def test_a_log_without_what_gives_a_heat_is_refused(channel: str) -> None:
    """No heat would be another one, and whatever the machine did would be missing from the model."""
    config = machine()
    log = made_log(config, 1)
    values = log.values.copy()
    values[:, log.channels.index(channel)] = np.nan
    with pytest.raises(LogError, match=f"^log 1: {channel}, an input of a heat law, has no value; fix that"):
        prepare(config, [replace(log, values=values)], "log 1")
    values[10, log.channels.index(channel)] = 1.0
    prepare(config, [replace(log, values=values)], "log 1")
