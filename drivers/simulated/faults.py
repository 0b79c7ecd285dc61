"""Faults that can be switched on in the simulated machine."""

from __future__ import annotations

from typing import Annotated

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field


def _one_or_many(names: object) -> object:
    return (names,) if isinstance(names, str) else names


Names = Annotated[tuple[str, ...], BeforeValidator(_one_or_many)]


class Faults(BaseModel):
    """The faults in force: thermocouples by name, the rest of the wires as a whole."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    open: Names = ()
    over_range: Names = ()
    stuck: Names = ()
    exception: Annotated[int, Field(ge=1, le=11)] | None = None
    drop_modbus: bool = False
    silence_can: bool = False


class Command(BaseModel):
    """One line on standard input: `{"fault": {"open": "t3_degC"}}`; `{"fault": {}}` clears everything."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    fault: Faults
