"""The configuration's tables of how the screw is held and how a control may compensate its growth."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, model_validator

from observer.config.quantities import Channel, Count, Finite, Flag, NonNegative, Position, Positive, Section

Stiffness = Annotated[Positive, Field(ge=1.0)]


class Supports(Section):
    """The axial supports of the screw (Kuznetsov's mountings L-I to L-IV).

    Only L-III, with both ends held, has forces. Stiffnesses, pre-tension and clearance are rejected in the
    others.
    """

    #: `"L-I"`: both supports let it slide; `"L-II"`: the first holds, the second only carries; `"L-III"`:
    #: both hold; `"L-IV"`: the first holds, there is no second
    mounting: Literal["L-I", "L-II", "L-III", "L-IV"]
    first: Literal["left", "right"] = "left"  #: which end the first support is at
    #: L-III: axial stiffness of the first support with its bearing; – is rigid
    stiffness_first_N_m: Stiffness | None = None
    stiffness_second_N_m: Stiffness | None = None  #: L-III: that of the second
    preload_N: NonNegative = 0.0  #: L-III: pre-tension of the cold screw
    #: L-III: growth after the pre-tension is lost until the second support pushes; large for a support that
    #: only pulls
    gap_m: Position = 0.0
    elastic_modulus_Pa: Annotated[Positive, Field(ge=1e6, le=1e13)] = 2.06e11  #: of the screw
    permitted_load_N: Positive | None = None  #: largest axial force, for `compare --minimise error`; – is any

    @model_validator(mode="after")
    def _only_where_two_supports_hold(self) -> Supports:
        stated = self.model_fields_set - {"mounting", "first", "permitted_load_N"}
        if self.mounting != "L-III" and stated:
            raise ValueError(
                f'{sorted(stated)[0]} has no effect in mounting = "{self.mounting}", where no force arises; '
                'remove it, or choose "L-III"'
            )
        return self


class ModbusControl(Section):
    """A control that takes the compensation over Modbus TCP holding registers."""

    kind: Literal["modbus"]  #: `"modbus"`: holding registers over Modbus TCP
    #: the control, or the PLC beside it
    host: Annotated[str, Field(min_length=1, max_length=256, pattern=r"^\S+$")]
    port: Annotated[Count, Field(ge=1, le=65535)] = 502  #: its port
    unit_id: Annotated[Count, Field(ge=0, le=255)] = 1  #: its unit
    first_register: Annotated[Count, Field(ge=0, le=0xFF00)] = 0  #: where its registers begin
    timeout_s: Annotated[Positive, Field(ge=0.01, le=5.0)] = 0.2  #: time to wait for an answer
    follow_s: Annotated[NonNegative, Field(le=4.0)] = 1.0  #: time for the control to report that it follows


MOST_POINTS = 50
"""A longer table does not fit into one request of Modbus, and no control must see half of one."""


class Compensation(Section):
    """The table and line by which a control removes the thermal error from its axis; off unless enabled.

    To enable it, the configuration must state that nothing else compensates, and that the axis is positioned
    by the motor's encoder.
    """

    enabled: Flag = False  #: publish `compensation`; it still has to be armed
    #: must be `false`: nothing else compensates the growth of this screw
    controller_compensates: Flag | None = None
    #: must be `"motor"`: the axis is positioned by the motor's encoder
    position_feedback: Literal["motor", "scale"] | None = None
    #: travel of the nut; – is the first source's stroke, else the whole screw
    travel_m: tuple[Position, Position] | None = None
    reference_m: Position | None = None  #: the line's reference on the screw; – is the middle of the travel
    zero_m: Finite = 0.0  #: where on the screw the machine's zero is
    reverse: Flag = False  #: the machine counts opposite to the screw's direction
    points: Annotated[Count, Field(ge=2, le=200)] = 21  #: points of the table
    rate_limit_um_s: Positive = 1.0  #: largest rate of change of the compensation, anywhere in the travel
    gradient_limit_um_m: Positive = 100.0  #: largest slope of table and line
    #: largest error, and largest [bound](../how-to/compensate.md#arm-it), in the travel; beyond it for
    #: `hold_s`, the compensation is released
    limit_um: Positive = 200.0
    #: how long values are held in doubt before they go to zero
    hold_s: Annotated[NonNegative, Field(le=600.0)] = 10.0
    #: channel that rises from 0 to 1 at [a new zero](../how-to/compensate.md#a-new-zero); – is by command
    #: only
    zero_channel: Channel | None = None
    zero_at_m: Position | None = None  #: place of the zero on the screw; – is where the nut stands then
    #: `"homing"`: a zero absorbs the whole error; `"probing"`: the error that the compensation leaves
    zero_after: Literal["homing", "probing"] = "homing"
    control: ModbusControl | None = None  #: `[compensation.control]`: the control to write to; – is none

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
