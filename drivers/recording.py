"""CAN recordings: every frame of a file, and an error where the file was cut off.

python-can reads a truncated file without an error. Vector's formats mark their end: an `.asc` with its
last trigger block closed, a `.blf` with its own length in the header.
"""

from __future__ import annotations

import sqlite3
import struct
import zlib
from collections.abc import Iterator
from pathlib import Path

import can
from can.io.blf import BLFParseError

from drivers.can_bus import Decode
from observer.errors import LogError
from observer.frames import Reading
from observer.process.memory import import_mf4

_REMEDY = "copy the recording again, or convert what is left of it to a new file"
# What the readers of python-can raise for invalid bytes.
_DAMAGE = (BLFParseError, can.CanError, sqlite3.Error, struct.error, zlib.error, LookupError, EOFError)
_BLF_HEADER = 144
_TAIL = 200
# Formats in which only the last line shows whether the file is complete.
LINE_FORMATS = (".log", ".csv", ".trc")


def messages_of(path: Path) -> Iterator[can.Message]:
    """The frames of a recording in order.

    Raises `LogError` for a file that cannot be read, and, after the frames before the cut, for one that was
    cut off. The frame at the cut is not given: half a line can look like a whole frame.
    """
    _check_head(path)
    if ".mf4" in path.suffixes:
        import_mf4()
    # Absolute times, so that recordings of two buses can be laid side by side.
    options = {"relative_timestamp": False} if ".asc" in path.suffixes else {}
    count = 0
    last = None
    try:
        with can.LogReader(path, **options) as reader:
            for frame in reader:
                if last is not None:
                    yield last
                last = frame
                count += 1
    except OSError as error:
        raise LogError(f"{path}: cannot be read ({error.strerror or error}); give a readable file") from None
    except ValueError as error:
        if count == 0:
            raise LogError(
                f"{path}: not a CAN recording that can be read ({error}); check its kind"
            ) from None
        raise LogError(f"{path}: damaged after frame {count} ({error}); {_REMEDY}") from None
    except _DAMAGE as error:
        raise LogError(f"{path}: damaged after frame {count} ({error}); {_REMEDY}") from None
    cut = how_cut(path)
    if cut:
        raise LogError(f"{path}: cut off after frame {max(count - 1, 0)} ({cut}); {_REMEDY}")
    if last is not None:
        yield last


def _check_head(path: Path) -> None:
    """Reject a file that is not a recording at all before a reader opens it."""
    try:
        with path.open("rb") as file:
            head = file.read(_BLF_HEADER)
    except FileNotFoundError:
        raise LogError(f"{path}: no such file; give the path of a CAN recording") from None
    except OSError as error:
        raise LogError(f"{path}: cannot be read ({error.strerror or error}); give a readable file") from None
    if path.suffix.lower() == ".blf" and not (head.startswith(b"LOGG") and len(head) == _BLF_HEADER):
        raise LogError(f"{path}: not a CAN recording (a .blf begins with LOGG and a header); check its kind")


def how_cut(path: Path) -> str | None:
    """Why a recording is not complete, or None without a sign of that."""
    suffix = path.suffix.lower()
    if suffix == ".blf":
        return _cut_blf(path)
    if suffix == ".asc":
        return _cut_asc(_tail(path))
    if suffix in LINE_FORMATS and not _tail(path).endswith(b"\n"):
        return "its last line is not finished"
    return None


def _cut_blf(path: Path) -> str | None:
    """Compare the length that the header of a `.blf` gives with the file's own."""
    with path.open("rb") as file:
        recorded: int = struct.unpack_from("<Q", file.read(_BLF_HEADER), 16)[0]
    length = path.stat().st_size
    if recorded == 0:
        return "its header was never completed, so the recorder was killed"
    if length < recorded:
        return f"it has {length} of its {recorded} bytes"
    return None


def _cut_asc(tail: bytes) -> str | None:
    """Look for the closing line of an `.asc`."""
    lines = tail.decode("utf-8", errors="replace").splitlines()
    last = next((line.strip().lower() for line in reversed(lines) if line.strip()), "")
    return None if last.startswith("end trigger") else 'its closing line "End TriggerBlock" is missing'


def _tail(path: Path) -> bytes:
    with path.open("rb") as file:
        size = file.seek(0, 2)
        file.seek(max(0, size - _TAIL))
        return file.read()


def readings_of(recording: Path, decode: Decode) -> Iterator[Reading]:
    """Replay a CAN recording through the decoding of the live bus, with the recording's own times.

    Raises `UserError` when the recording cannot be read or was cut off; what came before the cut has been
    given by then.
    """
    for frame in messages_of(recording):
        decoded = decode(frame)
        if decoded is not None and decoded[0]:
            yield Reading(frame.timestamp, *decoded)
