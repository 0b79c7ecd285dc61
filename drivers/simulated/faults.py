"""Faults that can be switched on in the simulated machine."""

from __future__ import annotations

from typing import Annotated

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field


def _one_or_many(names: object) -> object:
    return (names,) if isinstance(names, str) else names


Share = Annotated[float, Field(ge=0.0, le=1.0)]
Names = Annotated[tuple[str, ...], BeforeValidator(_one_or_many)]


class Faults(BaseModel):
    """The faults in force: thermocouples by name, the rest of the wires as a whole.

    CAN frames are held up for `hold_can_s` and then delivered at once: now, or at random, on average every
    `hold_can_every_s`. `drop_can`, `double_can` and `swap_can` are shares of frames to which that happens.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    open: Names = ()
    over_range: Names = ()
    stuck: Names = ()
    exception: Annotated[int, Field(ge=1, le=11)] | None = None
    drop_modbus: bool = False
    silence_can: bool = False
    hold_can_s: Annotated[float, Field(ge=0.0, le=10.0)] = 0.0
    hold_can_every_s: Annotated[float, Field(ge=0.1)] | None = None
    drop_can: Share = 0.0
    double_can: Share = 0.0
    swap_can: Share = 0.0


class Command(BaseModel):
    """One line on standard input: `{"fault": {"open": "t3_degC"}}`; `{"fault": {}}` clears everything."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    fault: Faults
