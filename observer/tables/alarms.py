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
    that, as a part of it, is told; `sensor_K`: how far a sensor has to be from the model, or from what its
    offset was, to be told; `off`: kinds that are not raised.
    """

    enabled: Flag = True
    learn_h: Annotated[Number, Field(ge=1.0, le=1000.0)] = 30.0
    deadband: Annotated[Number, Field(ge=0.05, le=3.0)] = 0.25
    sensor_K: Annotated[Number, Field(ge=0.05, le=20.0)] = 0.5
    off: tuple[AlarmKind, ...] = ()
