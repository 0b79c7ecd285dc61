"""What kernels take and fill: records of arrays that live as long as what they belong to.

Each is made from a NamedTuple of the same fields (`observer.kernels.record`), on the same memory; what the
fields are and of which shape stands there. Their types stand in `records.pxd`.
"""

from __future__ import annotations

from typing import Any


class Record:
    """Fields by name; compiled, each is an array or a number of the type in `records.pxd`."""

    def __init__(self, **fields: Any) -> None:
        """Take every field."""
        for name, value in fields.items():
            setattr(self, name, value)


class Links(Record):
    """Links."""


class Spreads(Record):
    """Spreads."""


class Fades(Record):
    """Fades."""


class Coupling(Record):
    """Coupling."""


class LearningArrays(Record):
    """Learning arrays."""


class AdvancePlant(Record):
    """Advance plant."""


class PlantArrays(AdvancePlant):
    """Plant arrays."""


class AdvanceTable(Record):
    """Advance table."""


class StepTable(AdvanceTable):
    """Step table."""


class AdvanceWork(Record):
    """Advance work."""


class Work(AdvanceWork):
    """Work."""


class Inputs(Record):
    """Inputs."""


class Running(Record):
    """Running."""


class Results(Record):
    """Results."""


class Gathered(Record):
    """Gathered."""


class Held(Record):
    """Held."""


class GainTable(Record):
    """Gain table."""


class Rungs(Record):
    """Rungs."""


class Columns(Record):
    """Columns."""


class Allowed(Record):
    """Allowed."""


class Tape(Record):
    """Tape."""


class Adjoint(Record):
    """Adjoint."""


class Smoothed(Record):
    """Smoothed."""


class ColumnsRead(Record):
    """Columns read."""


class Expected(Record):
    """Expected."""


class Memory(Record):
    """Memory."""


class SelfTestState(Record):
    """Self test state."""


class Trust(Record):
    """Trust."""


class Tested(Record):
    """Tested."""


class Rows(Record):
    """Rows."""


class Frames(Record):
    """Frames."""


class DriveDesk(Record):
    """Drive desk."""


class NutTable(Record):
    """Nut table."""


class NutDesk(Record):
    """Nut desk."""
