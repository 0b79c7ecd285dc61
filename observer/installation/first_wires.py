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
    """Raise `UserError` where the answer `name`, just given, does not fit the module or the control."""
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
    """A register on the wire, given as there or by a manual. Raises `UserError` for another function's."""
    of_manual = register_of_manual(number)
    if of_manual is None:
        return number
    if of_manual[0] != function:
        raise UserError(f"{number} is the manual's number of a register of {of_manual[0]}, not of {function}")
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
    """Return the channels on the module's inputs. Raises `UserError` where it has too few inputs."""
    names = [f"{name}_degC" for name in answers.thermocouples]
    names += ["ambient_degC"] if answers.ambient == "input" else []
    _inputs(answers, len(names))
    return names


def raw_code(code: str, kind: str) -> str:
    """The raw value, in hexadecimal, by which registers of a type hold a code as it was typed."""
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
    """Return host and port. Raises `UserError`, which names the option of `name`, for an invalid address."""
    host, _, port = place.partition(":")
    if not host or (port and not port.isdigit()):
        raise UserError(
            f"{option(name)}: {place!r} is not an address; write it as 192.168.0.20 or 192.168.0.20:502"
        )
    return host, int(port or 502)


_LEAST_PART, _MOST_PART = 0.9, 1.1
"""Of the stroke, between what the control shows at its ends."""


def direction_of_counts(answers: Answers) -> float:
    """1, or -1 where the control counts towards the left bearing.

    Raises `UserError` where what it shows at the ends does not fit the stroke or the sign of its counts.
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
    """The message and the signal of a DBC file that an answer names."""
    answer = str(getattr(answers, name))
    message, _, signal = answer.partition(".")
    if not message or not signal:
        raise UserError(f"{option(name)}: {answer!r} names no signal; write it as AxisStatus.NutPosition")
    return message, signal


_LIKE = {"opcua": "opc.tcp://192.168.0.21:4840", "mtconnect": "http://192.168.0.21:5000"}
"""How the address of each kind of server is written."""


def url_of(answers: Answers) -> str:
    """The address of the control's own server."""
    example = _LIKE[answers.control]
    if not answers.control_at.startswith(example.partition("//")[0]):
        raise UserError(f"--control-at: {answers.control_at!r} is not an address; write it as {example}")
    return answers.control_at
