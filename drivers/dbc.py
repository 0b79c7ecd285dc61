"""CAN frames to channel values by a DBC file; pure once the file is loaded.

cantools decodes bits and accepts every number. Here the minimum and maximum of the file apply too, and a
status signal can declare a value bad.
"""

from __future__ import annotations

import math
import re
from collections import defaultdict
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from drivers.dbc_faults import faulty_line, lines_of_messages, message_names
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
    """The channels of each message, by CAN identifier and whether the identifier is extended.

    Attributes:
        messages: For each message its description by cantools, and the names and signals of its channels.
    """

    messages: dict[tuple[int, bool], tuple[Any, tuple[tuple[str, CanChannel], ...]]]

    def __call__(self, frame: can.Message) -> Decoded | None:
        """Return values and faults of the channels in a frame.

        The faults are `short_frame`, `bad_frame`, `not_a_number`, `out_of_range`, or those of the status
        signal. A channel of another branch of a multiplexed message is missing, not faulty.

        Returns:
            Values by channel, NaN where there is a fault, and the faults; None if the frame holds no channel.
        """
        if frame.is_error_frame or frame.is_remote_frame:
            return None
        entry = self.messages.get((frame.arbitration_id, frame.is_extended_id))
        if entry is None or entry[0].is_fd != frame.is_fd:
            return None
        message, channels = entry
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
    """Return the value of one channel and its fault: the status signal is judged first, then the file's
    limits.
    """
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
    """Return the decoder of a driver's signals.

    A file with errors in messages that are not used is accepted: only the lines of the used ones are parsed.

    Raises:
        UserError: If the DBC file cannot be read, a line of a used message is invalid, or a message or signal
            is missing or ambiguous. One sentence for each problem, with file and channel.
    """
    file = _load(signals)
    if problems := _missing(file, signals):
        raise UserError("; ".join(problems))
    grouped: dict[str, list[tuple[str, CanChannel]]] = defaultdict(list)
    for name, channel in signals.channels.items():
        grouped[channel.message].append((name, channel))
    messages = {}
    for message_name, entries in grouped.items():
        message = file.database.get_message_by_name(message_name)
        messages[message.frame_id, message.is_extended_frame] = (message, tuple(entries))
    return DbcDecoder(messages)


def dbc_problems(signals: Signals) -> list[str]:
    """Return a sentence for each problem that prevents a driver from decoding by its DBC file.

    It checks as `load_decoder` does and raises nothing; the list is empty if the file can be used.
    """
    try:
        return _missing(_load(signals), signals)
    except UserError as error:
        return [str(error)]


@dataclass(frozen=True, slots=True)
class _DbcFile:
    """The parsed messages of a DBC file, all or only the used ones, and the names of all its messages."""

    database: Any
    names: list[str]


def _load(signals: Signals) -> _DbcFile:
    """Parse a DBC file; errors in unused messages do not matter. Raises `UserError`."""
    path = signals.dbc
    try:
        text = read_regular(path, MOST_BYTES, "a DBC file").decode("cp1252", errors="replace")
    except OSError as error:
        raise UserError(f"{path}: cannot be read ({error.strerror}); give the path of a DBC file") from None
    if _problem_of(text) is None:
        database = _parsed(text)
        return _DbcFile(database, [message.name for message in database.messages])
    names = message_names(text)
    if not names:
        raise UserError(
            f"{path}: not a valid DBC file (no line begins with BO_); give the path of a DBC file"
        )
    used = lines_of_messages(text, {channel.message for channel in signals.channels.values()})
    if faulty := faulty_line(used, _problem_of):
        raise UserError(f"{path}: line {faulty[0]} cannot be read ({faulty[1]}); correct this line")
    return _DbcFile(_parsed(used), names)


def _parsed(text: str) -> Any:
    return cantools.database.load_string(text, database_format="dbc")


def _problem_of(text: str) -> str | None:
    """Return why a text is not a usable DBC file; None if it is one."""
    sizes = [int(size[:12]) for size in _MESSAGE.findall(text)]
    bits = [int(number[:12]) for place in _SIGNAL.findall(text) for number in place]
    if max(sizes, default=0) > MOST_MESSAGE_BYTES or max(bits, default=0) > 8 * MOST_MESSAGE_BYTES:
        # the parser would lay out its gigabytes of bits
        return f"a message or signal is larger than {MOST_MESSAGE_BYTES} bytes, which no bus carries"
    try:
        _parsed(text)
    except _NO_DBC as error:
        return one_line(str(error)).removeprefix("DBC: ").strip('".') or type(error).__name__
    return None


def _missing(file: _DbcFile, signals: Signals) -> list[str]:
    """Return a sentence for each message and signal that the file lacks."""
    problems = []
    for name, channel in signals.channels.items():
        place = f"{signals.dbc}: channel {name} of drivers.{signals.driver}"
        if channel.message not in file.names:
            problems.append(f'{place}: no message "{channel.message}"; the file has {_listed(file.names)}')
            continue
        if file.names.count(channel.message) > 1:
            problems.append(f'{place}: the file has message "{channel.message}" twice; remove one')
            continue
        signal_names = [s.name for s in file.database.get_message_by_name(channel.message).signals]
        problems += [
            f'{place}: no signal "{signal}"; the message has {_listed(signal_names)}'
            for signal in (channel.signal, channel.fault_signal)
            if signal is not None and signal not in signal_names
        ]
    return problems


def _listed(names: list[str]) -> str:
    """Return the first names of a list, separated by commas, for an error message."""
    return ", ".join(names[:_MOST_LISTED]) + (" …" if len(names) > _MOST_LISTED else "") or "none"
