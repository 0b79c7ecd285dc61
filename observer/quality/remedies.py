"""What to look at when a channel delivers a fault, or nothing: a sentence for each of the drivers' faults."""

from __future__ import annotations

_REMEDIES = {
    "disconnected": "look whether the device is on, cabled, and at the address or port of its table",
    "timeout": "the wire is there and nothing answers: look at unit_id, baud rate and parity, and timeout_s",
    "bad_reply": "what answers is no reply to this question: look at unit_id, and for a second master",
    "silent": "the bus carries no such message: look at bit rate, cable, identifier and sender",
    "short_frame": "the message is shorter than its description: look at the DBC file or position_byte",
    "bad_frame": "the message does not fit its description: look at the DBC file",
    "open_circuit": "a thermocouple's wire is broken or not connected: look at the terminals of this input",
    "cold_junction": "the module cannot tell its terminals' temperature: look at the module, replace it",
    "under_range": "the thermocouple is the wrong way round, or of another type than the module is set to",
    "over_range": "the thermocouple is of another type than the module is set to, or its wire is open",
    "out_of_range": "the thermocouple's type or its connection is wrong, or low and high are too narrow",
    "register_communication": "the module waits for register commands: switch its control byte back",
    "not_ready": "the module is starting, or not configured: look at its project in the controller",
    "module_error": "the module reports an error of its own: look at its lamps and its manual",
    "not_a_number": "the device sends what is no number: look at type and word_order",
    "unreadable": "the value cannot be read as a number: look at the column or the signal",
    "end_of_log": "the log that is played has ended",
    "never_came": "nothing came in time: look at the driver's last error and at period_s",
}
_EXCEPTIONS = {
    1: 'the device does not know this function: give function = "holding" or "input"',
    2: "the device has no such register: look at register, counted from 0, and first_register",
    3: "the device refuses so many registers: look at register and type",
    4: "the device failed to read its own data: look at its lamps and its manual",
    6: "the device is busy: raise period_s, and look for a second master",
    10: "the gateway has no way to the unit: look at unit_id and the gateway's lines",
    11: "the unit behind the gateway does not answer: look at unit_id, power and cable",
}


def remedy_for(fault: str | None, implausible: str | None) -> str | None:
    """What to do about a channel; None where nothing is wrong with it.

    An implausible value says itself what it looks like; so the rest is where to fix it.
    """
    if fault is not None:
        if fault.startswith("exception_") and fault[10:].isdigit():
            return _EXCEPTIONS.get(
                int(fault[10:]), "the device refuses: look up this exception in its manual"
            )
        return _REMEDIES.get(fault, "look up this fault in the device's table and its manual")
    if implausible is not None:
        return "look at scale, offset, type and unit of the channel; if the value is right, at [limits]"
    return None
