"""CAN recordings: every whole frame of a file, and a sentence about each part that is damaged or cut off.

python-can reads a truncated file without an error. Vector's formats mark their end: an `.asc` closes its last
trigger block, and a `.blf` has its own length in the header. Formats of lines have no mark at the end. A line
that cannot be read is left out, and the frames after it are read.
"""

from __future__ import annotations

import gzip
import sqlite3
import struct
import zlib
from collections.abc import Iterator
from itertools import islice
from pathlib import Path
from typing import IO, Any, cast

import can
from can.io.blf import BLFParseError

from drivers.asc_dates import in_english, is_dated
from drivers.can_bus import Decode
from observer.errors import LogError
from observer.files.regular import one_line
from observer.frames import Reading
from observer.process.memory import import_mf4

_REMEDY = "copy the recording again, or convert what is left of it to a new file"
# What the readers of python-can raise for invalid bytes; `BadGzipFile` is an `OSError`.
_DAMAGE = (
    BLFParseError, can.CanError, sqlite3.Error, struct.error, zlib.error, LookupError, EOFError, ValueError,
    NotImplementedError, gzip.BadGzipFile,
)  # fmt: skip
_BLF_HEADER = 144
_MOST_DAMAGED = 20  # lines of a file that may be left out
_LINE_READERS: dict[str, Any] = {
    ".asc": can.ASCReader,
    ".log": can.CanutilsLogReader,
    ".csv": can.CSVReader,
    ".trc": can.TRCReader,
}


class CanRecording:
    """A recording of a bus, decoded as on the live bus, with the recording's own times.

    Iterating yields readings and raises `LogError` if the file cannot be read at all. `doubts` are sentences
    about lost frames and uncertain times. They are complete after the last reading.

    The suffix names the format, also before `.gz`: `.asc`, `.log`, `.csv`, `.trc`, `.blf`, `.mf4` or another
    of python-can's formats.

    Args:
        path: The file; it is opened by iterating.
        decode: Turns a frame into values and faults; frames for which it returns None are skipped.

    Attributes:
        doubts: Sentences with line or frame; empty if the file is whole.
    """

    def __init__(self, path: Path, decode: Decode) -> None:
        self.doubts: list[str] = []
        self._path = path
        self._decode = decode

    def __iter__(self) -> Iterator[Reading]:
        for frame in self._messages():
            decoded = self._decode(frame)
            if decoded is not None and decoded[0]:
                yield Reading(frame.timestamp, *decoded)

    def _messages(self) -> Iterator[can.Message]:
        """Yield the whole frames in order. Raises `LogError`."""
        _check_head(self._path)
        suffix = _suffix(self._path)
        try:
            if suffix in _LINE_READERS:
                yield from self._of_lines(_LINE_READERS[suffix], _options(suffix))
            else:
                yield from self._of_blocks(suffix)
        except OSError as error:
            reason = error.strerror or error
            raise LogError(f"{self._path}: cannot be read ({reason}); give a readable file") from None

    def _of_blocks(self, suffix: str) -> Iterator[can.Message]:
        """Yield the frames of a binary recording up to its end, or to the first damage."""
        if suffix == ".mf4":
            import_mf4()
        count = 0
        try:
            with can.LogReader(self._path) as reader:
                for frame in reader:
                    count += 1
                    yield frame
        except _DAMAGE as error:
            self._damaged(count, f"damaged after frame {count} ({_cause(error)})")
            return
        if suffix == ".blf" and (cut := _cut_blf(self._path)):
            self._damaged(count, f"cut off after frame {count} ({cut})")

    def _of_lines(self, reader: Any, options: dict[str, Any]) -> Iterator[can.Message]:
        """Yield the frames of a recording in lines; lines that cannot be read are left out."""
        left_out: list[int] = []
        count = 0
        while True:
            with _open_text(self._path) as file:
                lines = _Lines(file, left_out)
                try:
                    for frame in islice(reader(lines, **options), count, None):
                        count += 1
                        yield frame
                except _DAMAGE as error:
                    problem = f"line {lines.number} cannot be read ({_cause(error)})"
                    if len(left_out) == _MOST_DAMAGED or lines.number in left_out:
                        self._damaged(count, f"damaged after frame {count}: {problem}")
                        return
                    left_out.append(lines.number)
                    self.doubts.append(f"{problem} and is left out")
                    continue
            break
        self.doubts += lines.doubts
        if not count and self.doubts:
            self._damaged(count, self.doubts[0])
        if reader is can.ASCReader and not lines.is_closed and not lines.is_cut:
            self.doubts.append('the closing line "End TriggerBlock" is missing: the recording was cut off')

    def _damaged(self, count: int, problem: str) -> None:
        """Add a problem to the doubts. Raises `LogError` if no frame was read."""
        if not count:
            raise LogError(f"{self._path}: not a CAN recording that can be read: {problem}; check its kind")
        self.doubts.append(f"{problem}; {_REMEDY}")


class _Lines:
    """The whole lines of a recording as python-can reads them, with dates that it understands.

    `number` is the number of the line read last, from 1. `doubts` describe lines that are lost at the end.
    """

    def __init__(self, file: IO[str], left_out: list[int]) -> None:
        self.number = 0
        self.doubts: list[str] = []
        self.is_closed = self.is_cut = False
        self._file = file
        self._left_out = left_out

    def __iter__(self) -> Iterator[str]:
        return self

    def __next__(self) -> str:
        while True:
            line = self._next_line()
            self.number += 1
            if self.number in self._left_out:
                continue
            if not line.endswith("\n"):
                self.is_cut = True
                self.doubts.append(f"the last line ({self.number}) is cut off and left out")
                raise StopIteration
            if line.strip():
                self.is_closed = line.strip().lower().startswith("end trigger")
            if is_dated(line):
                line = self._with_date(line)
            return line

    def _next_line(self) -> str:
        try:
            return next(self._file)
        except (EOFError, zlib.error, gzip.BadGzipFile) as error:
            self.is_cut = True
            self.doubts.append(f"the file is cut off or damaged after line {self.number} ({_cause(error)})")
            raise StopIteration from None

    def _with_date(self, line: str) -> str:
        """Return a line with its date in English, or a comment line and a doubt if the date is not
        understood.
        """
        understood = in_english(line)
        if understood is not None:
            return understood
        self.doubts.append(
            f'the date in line {self.number}, "{one_line(line)}", is not understood, so the times count from '
            'the start of the recording; write it as "date Mon Mar 2 08:00:00.000 2026"'
        )
        return "//\n"

    def read(self, *_: Any) -> str:
        """Marks this as a file for python-can, which reads it line by line."""
        return ""

    def close(self) -> None:
        """Do nothing: the owner closes the file."""


def _suffix(path: Path) -> str:
    """Return the suffix that names the format, ignoring a final `.gz`."""
    suffixes = [suffix.lower() for suffix in path.suffixes]
    return suffixes[-2] if suffixes[-1:] == [".gz"] and len(suffixes) > 1 else "".join(suffixes[-1:])


def _options(suffix: str) -> dict[str, Any]:
    """Return the reader's options for absolute times, so that recordings of two buses have a common clock."""
    return {"relative_timestamp": False} if suffix == ".asc" else {}


def _open_text(path: Path) -> IO[str]:
    opener = gzip.open if path.suffix.lower() == ".gz" else open
    return cast("IO[str]", opener(path, "rt", encoding="utf-8", errors="replace"))


def _cause(error: Exception) -> str:
    return one_line(str(error)) or type(error).__name__


def _check_head(path: Path) -> None:
    """Reject a file that is not a recording at all before a reader opens it. Raises `LogError`."""
    try:
        with path.open("rb") as file:
            head = file.read(_BLF_HEADER)
    except FileNotFoundError:
        raise LogError(f"{path}: no such file; give the path of a CAN recording") from None
    except OSError as error:
        raise LogError(f"{path}: cannot be read ({error.strerror or error}); give a readable file") from None
    if path.suffix.lower() == ".blf" and not (head.startswith(b"LOGG") and len(head) == _BLF_HEADER):
        raise LogError(f"{path}: not a CAN recording (a .blf begins with LOGG and a header); check its kind")


def _cut_blf(path: Path) -> str | None:
    """Return how a `.blf` is shorter than the length in its header; None if it is complete."""
    with path.open("rb") as file:
        recorded: int = struct.unpack_from("<Q", file.read(_BLF_HEADER), 16)[0]
    length = path.stat().st_size
    if recorded == 0:
        return "its header was never completed, so the recorder was killed"
    if length < recorded:
        return f"it has {length} of its {recorded} bytes"
    return None
