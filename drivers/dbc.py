"""CAN frames to channel values by a DBC file; pure once the file is loaded.

cantools decodes bits but lets every number pass; here the file's own minimum and maximum hold, and a status
signal can declare a value bad.
"""

from __future__ import annotations

import math
import re
from collections import defaultdict
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from drivers.places import CanChannel, Signals
from drivers.protocol import Decoded
from observer.errors import UserError
from observer.files.regular import one_line, read_regular
from observer.process.memory import not_found

with not_found("asammdf"):  # python-can would load it, and with it pandas, to read files nobody has here
    import cantools
    from cantools.errors import Error as CantoolsError

if TYPE_CHECKING:
    import can


MOST_BYTES = 20_000_000
MOST_MESSAGE_BYTES = 1785  # of SAE J1939's transport protocol, the longest that a DBC file describes
_MOST_LISTED = 30
_MESSAGE = re.compile(r"\bBO_\s+\d+\s+\w+\s*:\s*(\d+)")
_SIGNAL = re.compile(r"\bSG_\s+\w+\s*\w*\s*:\s*(\d+)\s*\|\s*(\d+)")
# What the parser raises for invalid text; few of these are errors of its own.
_NO_DBC = (CantoolsError, ValueError, LookupError, TypeError, AttributeError, ArithmeticError, RecursionError)
# What it raises when a frame's bits are not a value: a missing branch, a float that is not an integer.
_NO_VALUE = (CantoolsError, ValueError, LookupError, TypeError, ArithmeticError)


@dataclass(frozen=True, slots=True)
class DbcDecoder:
    """The channels of each message, by CAN identifier and whether it is an extended one."""

    messages: dict[tuple[int, bool], tuple[Any, tuple[tuple[str, CanChannel], ...]]]

    def __call__(self, frame: can.Message) -> Decoded | None:
        """Values and faults of the channels in a frame; None when it holds none."""
        if frame.is_error_frame or frame.is_remote_frame:
            return None
        found = self.messages.get((frame.arbitration_id, frame.is_extended_id))
        if found is None or found[0].is_fd != frame.is_fd:
            return None
        message, channels = found
        values = {name: math.nan for name, _ in channels}
        if len(frame.data) < message.length:
            return values, dict.fromkeys(values, "short_frame")
        try:
            return _decoded(message, channels, bytes(frame.data))
        except _NO_VALUE:
            return values, dict.fromkeys(values, "bad_frame")


def _decoded(message: Any, channels: tuple[tuple[str, CanChannel], ...], data: bytes) -> Decoded:
    raw = message.decode(data, decode_choices=False, scaling=False)
    values: dict[str, float] = {}
    faults: dict[str, str] = {}
    for name, channel in channels:
        if channel.signal not in raw:  # another branch of a multiplexed message
            continue
        values[name], fault = _judge(raw, channel, message.get_signal_by_name(channel.signal))
        if fault is not None:
            faults[name] = fault
    return values, faults


def _judge(raw: dict[str, float], channel: CanChannel, signal: Any) -> tuple[float, str | None]:
    """The value of one channel and its fault: the status signal first, then the file's own limits."""
    if channel.fault_signal is not None:
        status = int(raw.get(channel.fault_signal, 0))
        fault = channel.fault_values.get(status)
        if fault is not None:
            return math.nan, fault
        if status and not channel.fault_values:
            return math.nan, f"status_{status}"
    physical = float(signal.raw_to_scaled(raw[channel.signal], decode_choices=False))
    if not math.isfinite(physical):
        return math.nan, "not_a_number"
    low, high = signal.minimum, signal.maximum
    if (low is not None and physical < low) or (high is not None and physical > high):
        return math.nan, "out_of_range"
    value = channel.value(physical)
    return (value, None) if math.isfinite(value) else (math.nan, "not_a_number")


def load_decoder(signals: Signals) -> DbcDecoder:
    """Read a DBC file and look every channel up in it.

    Raises `UserError` when the file cannot be used or does not have a message or signal.
    """
    database = _load(signals.dbc)
    if problems := _missing(database, signals):
        raise UserError("; ".join(problems))
    grouped: dict[str, list[tuple[str, CanChannel]]] = defaultdict(list)
    for name, channel in signals.channels.items():
        grouped[channel.message].append((name, channel))
    messages = {}
    for message_name, entries in grouped.items():
        message = database.get_message_by_name(message_name)
        messages[message.frame_id, message.is_extended_frame] = (message, tuple(entries))
    return DbcDecoder(messages)


def dbc_problems(signals: Signals) -> list[str]:
    """Return the problems that prevent a driver from decoding by its DBC file, a sentence each."""
    try:
        return _missing(_load(signals.dbc), signals)
    except UserError as error:
        return [str(error)]


def _load(path: Path) -> Any:
    """Parse a DBC file, whatever is in it; Raises `UserError`."""
    try:
        text = read_regular(path, MOST_BYTES, "a DBC file").decode("cp1252")
        _refuse_giants(path, text)
        database = cantools.database.load_string(text, database_format="dbc")
    except OSError as error:
        raise UserError(f"{path}: cannot be read ({error.strerror}); give the path of a DBC file") from None
    except _NO_DBC as error:
        reason = one_line(str(error)) or "unreadable"
        raise UserError(f"{path}: not a valid DBC file ({reason}); export it again") from None
    return database


def _refuse_giants(path: Path, text: str) -> None:
    """Raise `UserError` for a message that no bus carries; the parser would lay out its gigabytes of bits."""
    sizes = [int(size[:12]) for size in _MESSAGE.findall(text)]
    bits = [int(number[:12]) for place in _SIGNAL.findall(text) for number in place]
    if max(sizes, default=0) > MOST_MESSAGE_BYTES or max(bits, default=0) > 8 * MOST_MESSAGE_BYTES:
        raise UserError(
            f"{path}: not a valid DBC file (a message or signal is larger than {MOST_MESSAGE_BYTES} bytes); "
            "export it again"
        )


def _missing(database: Any, signals: Signals) -> list[str]:
    """Messages and signals that the file does not have, a sentence each."""
    found = []
    names = [message.name for message in database.messages]
    for name, channel in signals.channels.items():
        place = f"{signals.dbc}: channel {name} of drivers.{signals.driver}"
        if channel.message not in names:
            found.append(f'{place}: no message "{channel.message}"; the file has {_some(names)}')
            continue
        if names.count(channel.message) > 1:
            found.append(f'{place}: the file has message "{channel.message}" twice; remove one')
            continue
        there = [signal.name for signal in database.get_message_by_name(channel.message).signals]
        found += [
            f'{place}: no signal "{signal}"; the message has {_some(there)}'
            for signal in (channel.signal, channel.fault_signal)
            if signal is not None and signal not in there
        ]
    return found


def _some(names: list[str]) -> str:
    """The names a file has, no more than can be read."""
    return ", ".join(names[:_MOST_LISTED]) + (" …" if len(names) > _MOST_LISTED else "") or "none"
