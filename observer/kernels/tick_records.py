"""What the kernels of a reading, a tick and a message take (see `records`)."""

from __future__ import annotations

from observer.kernels.records import Record


class Products(Record):
    """Products."""


class PathSamples(Record):
    """Path samples."""


class LiveNut(Record):
    """Live nut."""


class LiveWalk(Record):
    """Live walk."""


class DriveTick(Record):
    """Drive tick."""


class EstimatorTick(Record):
    """Estimator tick."""


class TestTick(Record):
    """Test tick."""


class LiveStep(Record):
    """Live step."""


class Message(Record):
    """Message."""
