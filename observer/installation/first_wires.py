"""Checks and conversions of answers about wires: the thermocouples' module, and the nut's position."""

from __future__ import annotations

import math
import struct

from drivers.decode import bytes_of, words_of
from drivers.places import WORDS
from drivers.protocol import register_of_manual
from observer.errors import UserError
from observer.installation.catalogue import OTHER, Answers, option
from observer.installation.typed import is_serial


def check_wires(answers: Answers, name: str) -> None:
    """Check the answer just given against the module or the control.

    Args:
        answers: The answers so far.
        name: The field of that answer; most fields need no check.

    Raises:
        UserError: The module has too few inputs, or an address, a register or a reading does not fit.
    """
    if name == "inputs" or (name == "module" and answers.module != OTHER):
        _inputs(answers, len(answers.thermocouples))
    if name == "ambient":
        _inputs(answers, len(answers.thermocouples) + (answers.ambient == "input"))
    if name == "module_at" and answers.wire == "ethernet":
        modbus_place(answers.module_at)
    if name == "first_register":
        register_on_wire(answers.first_register, answers.function)
    if name == "control_at" and answers.control == "modbus" and not is_serial(answers.control_at):
        modbus_place(answers.control_at, name)
    if name == "control_at" and answers.control in _LIKE:
        url_of(answers)
    if name in ("position_signal", "speed_signal") and answers.control == "can" and getattr(answers, name):
        message_and_signal(answers, name)
    if name == "shown_at_ends_m":
        direction_of_counts(answers)


def register_on_wire(number: int, function: str) -> int:
    """Return a register as counted on the wire, from 0.

    Args:
        number: The register on the wire, or in a manual's counting, such as 40001.
        function: `holding` or `input`.

    Raises:
        UserError: The manual's number is one of the other function.
    """
    of_manual = register_of_manual(number)
    if of_manual is None:
        return number
    if of_manual[0] != function:
        raise UserError(
            f"{number} is the manual's number of a register of {of_manual[0]}, not of {function}; "
            "correct one of them"
        )
    return of_manual[1]


def _inputs(answers: Answers, count: int) -> None:
    """Raise `UserError` where the module has fewer than `count` inputs."""
    module = answers.reader
    if answers.wire and count > module.inputs:
        raise UserError(
            f"{count} inputs are needed (sensors, and the air where it is an input) and {module.title} has "
            f"{module.inputs}; leave some out, and add another module to the file afterwards"
        )


def module_channels(answers: Answers) -> list[str]:
    """Return the channels on the module's inputs, in their order, the air last if it is an input.

    Raises:
        UserError: The module has too few inputs.
    """
    names = [f"{name}_degC" for name in answers.thermocouples]
    names += ["ambient_degC"] if answers.ambient == "input" else []
    _inputs(answers, len(names))
    return names


def raw_code(code: str, kind: str) -> str:
    """Return the raw value, in hexadecimal, by which registers hold a fault code.

    Args:
        code: A decimal number, which is encoded as the type; or hexadecimal, which is taken as it is.
        kind: Type of the registers, such as `int16`.
    """
    words = WORDS[kind]
    if code.lower().startswith("0x"):
        return f"0x{int(code, 16):0{4 * words}X}"
    try:
        data = bytes_of(words_of(float(code), kind, "ABCD"))
    except (struct.error, OverflowError):
        wrapped = round(float(code)) & ((1 << 16 * words) - 1)
        data = wrapped.to_bytes(2 * words, "big")
    return f"0x{data.hex().upper()}"


def modbus_place(place: str, name: str = "module_at") -> tuple[str, int]:
    """Return host and port of an address; the port is 502 if none is given.

    Args:
        place: `host` or `host:port`.
        name: The field of the answer, whose option the error names.

    Raises:
        UserError: The address has another form.
    """
    host, _, port = place.partition(":")
    if not host or (port and not port.isdigit()):
        raise UserError(
            f"{option(name)}: {place!r} is not an address; write it as 192.168.0.20 or 192.168.0.20:502"
        )
    return host, int(port or 502)


_LEAST_PART, _MOST_PART = 0.9, 1.1
"""Of the stroke, between what the control shows at its ends."""


def direction_of_counts(answers: Answers) -> float:
    """Return 1, or -1 where the control counts towards the left bearing; 1 without the readings at the
    ends.

    Raises:
        UserError: The readings are more than 10 % off the stroke, or contradict the sign of `counts_per_m`.
    """
    if answers.shown_at_ends_m is None:
        return 1.0
    left_m, right_m = answers.shown_at_ends_m
    stroke_m = answers.stroke_m[1] - answers.stroke_m[0]
    shown_m = right_m - left_m
    if not _LEAST_PART * stroke_m <= abs(shown_m) <= _MOST_PART * stroke_m:
        raise UserError(
            f"the control then shows {1000 * abs(shown_m):g} mm from end to end, and the stroke is "
            f"{1000 * stroke_m:g} mm; correct one of them"
        )
    counts_per_m = getattr(answers, "counts_per_m", None)
    if counts_per_m is not None and counts_per_m * shown_m < 0.0:
        raise UserError(
            f"the control then counts towards the {'left' if shown_m < 0.0 else 'right'} bearing, and "
            f"counts_per_m = {counts_per_m:g} says otherwise; correct its sign, or exchange the two readings"
        )
    return math.copysign(1.0, shown_m)


def message_and_signal(answers: Answers, name: str) -> tuple[str, str]:
    """Return the message and the signal of a DBC file that an answer names as `message.signal`.

    Raises:
        UserError: One of the two is missing.
    """
    answer = str(getattr(answers, name))
    message, _, signal = answer.partition(".")
    if not message or not signal:
        raise UserError(f"{option(name)}: {answer!r} names no signal; write it as AxisStatus.NutPosition")
    return message, signal


_LIKE = {"opcua": "opc.tcp://192.168.0.21:4840", "mtconnect": "http://192.168.0.21:5000"}
"""How the address of each kind of server is written."""


def url_of(answers: Answers) -> str:
    """Return the address of the control's own server, OPC UA or MTConnect.

    Raises:
        UserError: It does not begin as such an address does.
    """
    example = _LIKE[answers.control]
    if not answers.control_at.startswith(example.partition("//")[0]):
        raise UserError(f"--control-at: {answers.control_at!r} is not an address; write it as {example}")
    return answers.control_at
