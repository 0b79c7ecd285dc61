"""What a service keeps on disk (its recordings, its estimator's state), and which alarms it raises."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field

from observer.tables.quantities import Flag, NonNegative, Number, Positive, Section

STATE_DIRECTORY = "STATE_DIRECTORY"
"""Where systemd says that a unit may keep its state; several places are parted by colons."""


class Record(Section):
    """Where the lossless log of the daemon goes; `directory` unset means that nothing is recorded."""

    directory: Path | None = None
    rotate_MB: Positive = 64.0
    sync_s: Positive = 5.0
    keep_days: Positive | None = None
    keep_GB: Positive | None = None
    keep_free_GB: NonNegative = 1.0


class Checkpoint(Section):
    """Where the service leaves what it knows, so that a restart goes on from there."""

    enabled: bool = True
    directory: Path | None = None
    period_s: Annotated[float, Field(ge=0.1, le=3600)] = 10.0
    oldest_s: Annotated[float, Field(gt=0, le=86_400)] = 900.0

    def place(self, record: Record) -> Path | None:
        """The directory in force: as configured, else that of the recordings, else systemd's; None is off."""
        if not self.enabled:
            return None
        if self.directory is not None or record.directory is not None:
            return self.directory or record.directory
        given = os.environ.get(STATE_DIRECTORY, "").split(":")[0]
        return Path(given) if given else None


AlarmKind = Literal[
    "sensor_fault", "sensor_stuck", "sensor_disagrees", "heat_high", "heat_low", "heat_off_law",
    "model_inconsistent", "wire", "disk", "clock", "estimate",
]  # fmt: skip


class AlarmSettings(Section):
    """Which alarms there are, and when a heat is more than usual.

    `learn_h`: hours of running in which the usual heat of a source is learnt; `deadband`: how much more than
    that, as a part of it, is told; `sensor_K`: how far a sensor has to be from the model, or from what its
    offset was, to be told; `off`: kinds that are not raised.
    """

    enabled: Flag = True
    learn_h: Annotated[Number, Field(ge=1.0, le=1000.0)] = 30.0
    deadband: Annotated[Number, Field(ge=0.05, le=3.0)] = 0.25
    sensor_K: Annotated[Number, Field(ge=0.05, le=20.0)] = 0.5
    off: tuple[AlarmKind, ...] = ()
