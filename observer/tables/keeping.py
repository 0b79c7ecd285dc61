"""The configuration of what a service keeps on disk: its recordings and where its estimator stands."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Annotated

from pydantic import Field

from observer.tables.quantities import NonNegative, Positive, Section

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
