"""A recording part by part: whole blocks of it, so that memory does not depend on the size of a file."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from observer.errors import LogError
from observer.files.log_checks import CHECKSUM
from observer.files.logs import Log, read_part
from observer.record.retention import is_being_written

_PART_BYTES = 1 << 20
_MOST_BYTES = 1 << 24
"""Of a block; a recording of an older version has no blocks."""
_LINE_BYTES = 1 << 16


@dataclass(frozen=True, slots=True)
class RecordedPart:
    """Some rows of a recording, None where there are none, and where in the file the next part begins.

    `lost` describes what could not be used, None if nothing.
    """

    log: Log | None
    end: int
    lost: str | None


def parts(path: Path, needed: Sequence[str], begin: int = 0) -> Iterator[RecordedPart]:
    """The parts of a recording from a place on where a part ended before.

    Of a file that is being written, what is whole. Raises `OSError`, and `LogError` where a channel is not in
    it.
    """
    is_open = is_being_written(path)
    with path.open("rb") as file:
        first = file.readline(_LINE_BYTES)
        read_part(path, first, first, needed)
        file.seek(begin)
        rest, is_within_line = b"", False
        while True:
            data = file.read(_PART_BYTES)
            is_end = not data
            if is_within_line:
                tail, newline, data = data.partition(b"\n")
                begin += len(tail) + len(newline)
                is_within_line = bool(tail) and not newline
                if is_within_line:
                    continue
            rest += data
            if len(rest) >= _MOST_BYTES and b"\n" not in rest:
                begin, rest, is_within_line = begin + len(rest), b"", True
                lost = f"{path.name} has a line of more than {_MOST_BYTES >> 20} MB, which is left out"
                yield RecordedPart(None, begin, lost)
                continue
            size = _whole(rest, is_last=is_end and not is_open)
            if size:
                begin += size
                yield _part(path, first, rest[:size], needed, begin)
                rest = rest[size:]
            if is_end:
                return


def _whole(data: bytes, *, is_last: bool) -> int:
    """The length in bytes of whole blocks; at the end of a file, or in a very long block, of whole rows."""
    end = data.rfind(b"\n") + 1
    mark = data.rfind(CHECKSUM, 0, end)
    if is_last or (mark < 0 and len(data) >= _MOST_BYTES):
        return end
    return 0 if mark < 0 else data.find(b"\n", mark) + 1


def _part(path: Path, first: bytes, data: bytes, needed: Sequence[str], end: int) -> RecordedPart:
    try:
        log, damaged = read_part(path, first, data.rstrip(b"\0"), needed)
    except LogError as error:
        return RecordedPart(None, end, f"{error}; the rows around it are left out")
    lost = f"{path.name}: damaged rows are left out, {damaged} blocks of them" if damaged else None
    return RecordedPart(log, end, lost)
