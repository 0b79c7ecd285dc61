"""What a service keeps on disk (its recordings, its estimator's state), and which alarms it raises."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field

from observer.tables.quantities import Flag, NonNegative, Number, Positive, Section

STATE_DIRECTORY = "STATE_DIRECTORY"
"""Where systemd says that a unit may keep its state; several places are parted by colons."""


class RecordSettings(Section):
    """Where the lossless log of the daemon goes."""

    directory: Path | None = None  #: where the recordings go; – records nothing
    rotate_MB: Positive = 64.0  #: a new file begins at this size
    sync_s: Positive = 5.0  #: the file is forced to disk this often
    #: complete files whose last row is older than this are removed; – is no age
    keep_days: Positive | None = None
    #: the oldest complete files are removed beyond this size in all; – is no size
    keep_GB: Positive | None = None
    #: the oldest complete files are removed so that this much of the disk, but at most a tenth of it, stays
    #: free; 0 removes none for that
    keep_free_GB: NonNegative = 1.0


class Checkpoint(Section):
    """Where the service leaves what it knows, so that a restart goes on from there."""

    enabled: bool = True  #: whether it does
    #: where; – is the recordings' directory, else systemd's `$STATE_DIRECTORY`, else it is off
    directory: Path | None = None
    period_s: Annotated[float, Field(ge=0.1, le=3600)] = 10.0  #: how often; once more at the end
    oldest_s: Annotated[float, Field(gt=0, le=86_400)] = 900.0  #: an older one is left aside at the start

    def place(self, record: RecordSettings) -> Path | None:
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
    """Which alarms there are, and when a heat is more than usual."""

    enabled: Flag = True  #: whether there are any
    #: hours of running in which the usual heat of each source is learnt, 1 to 1000
    learn_h: Annotated[Number, Field(ge=1.0, le=1000.0)] = 30.0
    #: how much more or less than usual, as a part of it, a heat has to be, 0.05 to 3
    deadband: Annotated[Number, Field(ge=0.05, le=3.0)] = 0.25
    #: how far a sensor's learnt offset has to be from what it was, 0.05 to 20
    sensor_K: Annotated[Number, Field(ge=0.05, le=20.0)] = 0.5
    off: tuple[AlarmKind, ...] = ()  #: kinds that are not raised, such as `["sensor_disagrees"]`
