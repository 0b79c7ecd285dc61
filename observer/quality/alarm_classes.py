"""The classes of alarms and the faults of channels, with a remedy for each.

A new class of alarms is one record here, and its name in `AlarmKind` of the configuration.
"""

from __future__ import annotations

from typing import NamedTuple

from observer.bus.exchange import Severity
from observer.config.publishing import AlarmKind


class AlarmClass(NamedTuple):
    """A class of alarms, with its life by ISA-18.2 (2016).

    Attributes:
        name: The name in the configuration and in documents.
        severity: How bad it is, by EPICS.
        on_s: How long the condition must hold, in s, before the alarm is raised.
        off_s: How long it must not hold, in s, before the alarm returns to normal.
        latched: Whether it stays until somebody acknowledges it.
        remedy: What a maintenance engineer does about it.
    """

    name: AlarmKind
    severity: Severity
    on_s: float
    off_s: float
    latched: bool
    remedy: str


SENSOR_FAULT_ALARM = AlarmClass(
    "sensor_fault", "major", 5.0, 10.0, False,
    "check the sensor's plug, its cable and the module's status; the estimate continues without it",
)  # fmt: skip
SENSOR_STUCK_ALARM = AlarmClass(
    "sensor_stuck", "major", 0.0, 60.0, True,
    "the value no longer changes: check whether the sensor has come loose or the module hangs",
)  # fmt: skip
SENSOR_DISAGREES_ALARM = AlarmClass(
    "sensor_disagrees", "minor", 600.0, 600.0, True,
    "compare the sensor with another thermometer while the machine is cold; put its offset_K into the "
    "configuration, or replace it",
)  # fmt: skip
HEAT_HIGH_ALARM = AlarmClass(
    "heat_high", "major", 0.0, 3600.0, True,
    "more heat than learnt for this speed and temperature: check lubrication, preload and bearing "
    "before the next shift; the trend shows how much time is left",
)  # fmt: skip
HEAT_LOW_ALARM = AlarmClass(
    "heat_low", "minor", 0.0, 3600.0, True,
    "less heat than learnt for this speed and temperature, as when preload or belt tension is lost: "
    "measure the backlash, check the preload of nut and bearings",
)  # fmt: skip
HEAT_OFF_LAW_ALARM = AlarmClass(
    "heat_off_law", "minor", 600.0, 86_400.0, False,
    "check unit and position of the channels that this heat's law reads; `observer calibrate` "
    "refits the law",
)  # fmt: skip
MODEL_INCONSISTENT_ALARM = AlarmClass(
    "model_inconsistent", "minor", 0.0, 600.0, True,
    "run `observer discover --recent 8h`, which names the missing effect",
)  # fmt: skip
WIRE_ALARM = AlarmClass(
    "wire", "major", 5.0, 10.0, False,
    "check power, cable and address of the device; the service retries automatically",
)  # fmt: skip
DISK_ALARM = AlarmClass(
    "disk", "major", 10.0, 60.0, False, "free space or fix the folder that recordings are written to"
)  # fmt: skip
COMPENSATION_ALARM = AlarmClass(
    "compensation", "major", 0.0, 0.0, True,
    "remove the cause that the alarm names, check that `observer health` shows good estimates, then arm "
    "again with `observer arm`",
)  # fmt: skip
CLOCK_ALARM = AlarmClass(
    "clock", "minor", 0.0, 60.0, True,
    "check the computer's time service; compare times before and after with care",
)  # fmt: skip
ESTIMATE_ALARM = AlarmClass(
    "estimate", "invalid", 0.0, 10.0, True,
    "the estimator failed: keep the recording and the log, restart the service",
)  # fmt: skip
ALARM_CLASSES: dict[str, AlarmClass] = {
    alarm.name: alarm
    for alarm in (
        SENSOR_FAULT_ALARM, SENSOR_STUCK_ALARM, SENSOR_DISAGREES_ALARM, HEAT_HIGH_ALARM, HEAT_LOW_ALARM,
        HEAT_OFF_LAW_ALARM, MODEL_INCONSISTENT_ALARM, WIRE_ALARM, DISK_ALARM, COMPENSATION_ALARM,
        CLOCK_ALARM, ESTIMATE_ALARM,
    )
}  # fmt: skip


class ChannelFault(NamedTuple):
    """A fault that a driver or the aligner reports of a channel.

    Attributes:
        remedy: What a maintenance engineer does about it.
        alarm: The class of its alarm; None if another alarm covers it.
    """

    remedy: str
    alarm: AlarmClass | None = SENSOR_FAULT_ALARM


CHANNEL_FAULTS = {
    "disconnected": ChannelFault(
        "check that the device is on, cabled, and at the address or port of its table",
        None,  # the driver has an alarm of its own
    ),
    "stuck": ChannelFault(SENSOR_STUCK_ALARM.remedy, SENSOR_STUCK_ALARM),
    "timeout": ChannelFault(
        "no answer in time: check power, cable, unit_id and timeout_s; on a serial line also "
        "baudrate, parity and stopbits"
    ),
    "slow_poll": ChannelFault(
        "a poll takes longer than period_s, as the driver's last error says: raise period_s, or "
        "read fewer registers"
    ),
    "bad_reply": ChannelFault(
        "the reply does not match the request: check unit_id, and look for a second master"
    ),
    "rtu_frames": ChannelFault(
        'the device answers in RTU frames: set transport = "rtu-over-tcp" for this driver'
    ),
    "tiny_number": ChannelFault(
        "the number is too small to be a measurement: check byte_order, type and register; the "
        "driver's last error names the order that fits"
    ),
    "silent": ChannelFault(
        "the bus carries no such message: check bit rate, cable, identifier and sender"
    ),
    "short_frame": ChannelFault(
        "the message is shorter than its description: check the DBC file or position_byte"
    ),
    "bad_frame": ChannelFault("the message does not fit its description: check the DBC file"),
    "open_circuit": ChannelFault(
        "a thermocouple's wire is broken or not connected: check the terminals of this input"
    ),
    "cold_junction": ChannelFault(
        "the module cannot measure its terminals' temperature: check the module, replace it"
    ),
    "under_range": ChannelFault(
        "the thermocouple is the wrong way round, or of another type than the module is set to"
    ),
    "over_range": ChannelFault(
        "the thermocouple is of another type than the module is set to, or its wire is open"
    ),
    "out_of_range": ChannelFault(
        "the thermocouple's type or its connection is wrong, or low and high are too narrow"
    ),
    "register_communication": ChannelFault(
        "the module waits for register commands: switch its control byte back"
    ),
    "not_ready": ChannelFault(
        "the module is starting, or not configured: check its project in the controller"
    ),
    "module_error": ChannelFault("the module reports an error of its own: check its lamps and its manual"),
    "not_a_number": ChannelFault(
        "the device sends something that is not a number: check type and byte_order"
    ),
    "unreadable": ChannelFault("the value cannot be read as a number: check the column or the signal"),
    "end_of_log": ChannelFault("the log that is played has ended"),
    "never_came": ChannelFault("nothing came in time: check the driver's last error and period_s"),
    "exception_1": ChannelFault(
        'the device does not know this function: give function = "holding" or "input"'
    ),
    "exception_2": ChannelFault(
        "the device has no such register: check register, counted from 0 (40001 or 30001 of a manual is 0), "
        "function and first_register"
    ),
    "exception_3": ChannelFault("the device rejects so many registers: check register and type"),
    "exception_4": ChannelFault("the device failed to read its own data: check its lamps and its manual"),
    "exception_6": ChannelFault("the device is busy: raise period_s, and check for a second master"),
    "exception_10": ChannelFault(
        "the gateway has no path to the unit: check unit_id and the gateway's lines"
    ),
    "exception_11": ChannelFault(
        "the unit behind the gateway does not answer: check unit_id, power and cable"
    ),
}  # fmt: skip
_OTHER_EXCEPTION = ChannelFault("the device rejects the request: look up this exception in its manual")
_OTHER_FAULT = ChannelFault("look up this fault in the device's table and its manual")


def channel_fault(name: str) -> ChannelFault:
    """Return the record of a channel's fault; one that no table lists points to the device's manual.

    Args:
        name: The fault's name, in lower case with underscores.
    """
    is_exception = name.startswith("exception_") and name[10:].isdigit()
    return CHANNEL_FAULTS.get(name, _OTHER_EXCEPTION if is_exception else _OTHER_FAULT)


def remedy_for(fault: str | None, implausible: str | None) -> str | None:
    """Return the remedy for a fault or an implausible value of a channel.

    Args:
        fault: The fault's name; None without one. It takes precedence.
        implausible: Why the value cannot be right; None if it may be.

    Returns:
        A sentence without full stop; None with neither.
    """
    if fault is not None:
        return channel_fault(fault).remedy
    if implausible is not None:
        return "check scale, offset, type and unit of the channel; if the value is right, check [limits]"
    return None
