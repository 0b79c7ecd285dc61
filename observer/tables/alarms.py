"""The configuration of alarms."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from observer.tables.quantities import Flag, Number, Section

AlarmKind = Literal[
    "sensor_fault", "sensor_stuck", "sensor_disagrees", "heat_high", "heat_low", "heat_off_law",
    "model_inconsistent", "wire", "disk", "clock", "estimate",
]  # fmt: skip


class AlarmSettings(Section):
    """Which alarms there are, and when a heat is more than usual.

    `learn_h`: hours of running in which the usual heat of a source is learnt; `deadband`: how much more than
    that, as a part of it, is told; `off`: kinds that are not raised.
    """

    enabled: Flag = True
    learn_h: Annotated[Number, Field(ge=1.0, le=1000.0)] = 30.0
    deadband: Annotated[Number, Field(ge=0.05, le=3.0)] = 0.25
    off: tuple[AlarmKind, ...] = ()
