"""The kinds of alarms: how bad each is, how long it has to last, whether it stays until somebody has seen it,
and what to do. The severities are those of EPICS; *invalid* says that a value cannot be used at all.
"""

from __future__ import annotations

from typing import Literal, NamedTuple

Severity = Literal["minor", "major", "invalid"]


class Kind(NamedTuple):
    """A kind of alarm.

    It is raised once its condition has held for `on_s` and returns to normal once it has not held for
    `off_s`; one that is `latched` stays until it is acknowledged. `remedy` says what to do.
    """

    severity: Severity
    on_s: float
    off_s: float
    latched: bool
    remedy: str


KINDS: dict[str, Kind] = {
    "sensor_fault": Kind(
        "major", 5.0, 10.0, False,
        "look at the sensor's plug, its cable and the module's status; the estimate goes on without it",
    ),
    "sensor_stuck": Kind(
        "major", 0.0, 60.0, True,
        "the value no longer changes: look whether the sensor has come loose and whether the module hangs",
    ),
    "sensor_disagrees": Kind(
        "minor", 600.0, 600.0, True,
        "compare the sensor with another thermometer while the machine is cold; put its offset_K into the "
        "configuration, or replace it",
    ),
    "heat_high": Kind(
        "major", 0.0, 3600.0, True,
        "more heat than learnt for this speed and temperature: look at lubrication, preload and bearing "
        "before the next shift; the trend says how long there is",
    ),
    "heat_low": Kind(
        "minor", 0.0, 3600.0, True,
        "less heat than learnt for this speed and temperature: look whether preload or belt tension is lost",
    ),
    "heat_off_law": Kind(
        "minor", 600.0, 86_400.0, False,
        "look at the unit and place of what this heat's law reads; `observer calibrate` fits the law anew",
    ),
    "model_inconsistent": Kind(
        "minor", 0.0, 600.0, True,
        "run `observer discover --recent 8h`, which names what the model lacks",
    ),
    "wire": Kind(
        "major", 5.0, 10.0, False,
        "look at power, cable and address of the device; it is tried again by itself",
    ),
    "disk": Kind("major", 10.0, 60.0, False, "free space or mend the place where recordings are written"),
    "clock": Kind(
        "minor", 0.0, 60.0, True, "look at the computer's time service; times go on from the service's start"
    ),
    "estimate": Kind(
        "invalid", 0.0, 10.0, True,
        "the estimator failed: keep the recording and the log, restart the service",
    ),
}  # fmt: skip
