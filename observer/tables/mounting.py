"""The configuration's tables of how the screw is held and how a control may compensate its growth."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, model_validator

from observer.tables.quantities import Count, Finite, Flag, NonNegative, Position, Positive, Section

Stiffness = Annotated[Positive, Field(ge=1.0)]


class Supports(Section):
    """The axial supports of the screw (Kuznetsov's mountings L-I to L-IV).

    L-I: both let it slide; L-II: the first holds it, the second only carries it; L-III: both hold it; L-IV:
    the first holds it, there is no second. A stiffness that is not given is rigid.
    """

    mounting: Literal["L-I", "L-II", "L-III", "L-IV"]
    first: Literal["left", "right"] = "left"
    stiffness_first_N_m: Stiffness | None = None
    stiffness_second_N_m: Stiffness | None = None
    preload_N: NonNegative = 0.0
    gap_m: Position = 0.0
    elastic_modulus_Pa: Annotated[Positive, Field(ge=1e6, le=1e13)] = 2.06e11

    @model_validator(mode="after")
    def _only_where_two_supports_hold(self) -> Supports:
        stated = self.model_fields_set - {"mounting", "first"}
        if self.mounting != "L-III" and stated:
            raise ValueError(
                f'{sorted(stated)[0]} has no effect in mounting = "{self.mounting}", where no force arises; '
                'remove it, or choose "L-III"'
            )
        return self


class ModbusControl(Section):
    """A control that takes the compensation over Modbus TCP holding registers."""

    kind: Literal["modbus"]
    host: Annotated[str, Field(min_length=1, max_length=256, pattern=r"^\S+$")]
    port: Annotated[Count, Field(ge=1, le=65535)] = 502
    unit_id: Annotated[Count, Field(ge=0, le=255)] = 1
    first_register: Annotated[Count, Field(ge=0, le=0xFF00)] = 0
    timeout_s: Annotated[Positive, Field(ge=0.01, le=5.0)] = 0.2


MOST_POINTS = 50
"""A longer table does not fit into one request of Modbus, and no control must see half of one."""


class Compensation(Section):
    """What a control is told so that it can take the thermal error out of its axis; off unless enabled."""

    enabled: Flag = False
    controller_compensates: Flag | None = None
    position_feedback: Literal["motor", "scale"] | None = None
    travel_m: tuple[Position, Position] | None = None
    reference_m: Position | None = None
    zero_m: Finite = 0.0
    reverse: Flag = False
    points: Annotated[Count, Field(ge=2, le=200)] = 21
    rate_limit_um_s: Positive = 1.0
    gradient_limit_um_m: Positive = 100.0
    limit_um: Positive = 200.0
    control: ModbusControl | None = None

    @model_validator(mode="after")
    def _fits_into_one_request(self) -> Compensation:
        if self.control is not None and self.points > MOST_POINTS:
            raise ValueError(
                f"points = {self.points} is more than a control takes; give {MOST_POINTS} at most"
            )
        return self

    @model_validator(mode="after")
    def _nobody_else_compensates(self) -> Compensation:
        if self.travel_m is not None and not self.travel_m[0] < self.travel_m[1]:
            raise ValueError("travel_m is empty; the first number must be the smaller")
        if not self.enabled:
            return self
        if self.controller_compensates is None:
            raise ValueError(
                "say with controller_compensates = false that nothing else compensates the screw's growth; "
                "two compensations would double the error"
            )
        if self.controller_compensates:
            raise ValueError(
                "the control already compensates the screw's growth, and twice would double the error; set "
                "enabled = false, or switch its own off and set controller_compensates = false"
            )
        if self.position_feedback != "motor":
            raise ValueError(
                'say with position_feedback = "motor" that the axis is positioned by the motor\'s encoder; a '
                "scale already measures the growth, and compensating it would make the error"
            )
        return self
