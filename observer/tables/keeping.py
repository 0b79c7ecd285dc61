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
    #: complete files whose last row is older than this are removed; – is no limit
    keep_days: Positive | None = None
    #: the oldest complete files are removed beyond this total size; – is no limit
    keep_GB: Positive | None = None
    #: the oldest complete files are removed so that this much of the disk, but at most a tenth of it, stays
    #: free; 0 removes none for that
    keep_free_GB: NonNegative = 1.0


class Checkpoint(Section):
    """Where the service saves its state, so that a restart continues from it."""

    enabled: bool = True  #: whether the state is saved
    #: its folder; – is the recordings' directory, else systemd's `$STATE_DIRECTORY`, else it is off
    directory: Path | None = None
    period_s: Annotated[float, Field(ge=0.1, le=3600)] = 10.0  #: how often; once more at the end
    oldest_s: Annotated[float, Field(gt=0, le=86_400)] = 900.0  #: an older one is ignored at the start

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

    enabled: Flag = True  #: whether alarms are raised
    #: hours of running in which the usual heat of each source is learnt, 1 to 1000
    learn_h: Annotated[Number, Field(ge=1.0, le=1000.0)] = 30.0
    #: relative deviation of a heat from usual that raises an alarm, 0.05 to 3
    deadband: Annotated[Number, Field(ge=0.05, le=3.0)] = 0.25
    #: change of a sensor's learnt offset that raises an alarm, 0.05 to 20
    sensor_K: Annotated[Number, Field(ge=0.05, le=20.0)] = 0.5
    off: tuple[AlarmKind, ...] = ()  #: kinds that are not raised, such as `["sensor_disagrees"]`
