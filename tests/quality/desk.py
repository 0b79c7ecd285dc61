"""A desk of alarms of the machine that the tests of learning have."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from observer.config.publishing import AlarmSettings
from observer.frames import Layout
from observer.quality.alarms import AlarmDesk
from tests.learning.machines import CONFIG, config_of

SENSORS = ("t1", "t2", "t3", "t4", "t5")
LAYOUT = Layout(
    ("nut", "left_bearing", "right_bearing"),
    np.linspace(0.0, 1.0, 5), SENSORS, False, tuple(f"sensor.{s}.offset_K" for s in SENSORS),
)  # fmt: skip
MACHINE = config_of(CONFIG)


def alarm_desk(file: Path | None = None, **settings: float) -> AlarmDesk:
    """A desk that keeps its state in `file`, if given."""
    return AlarmDesk(MACHINE, LAYOUT, AlarmSettings(**settings), file)
