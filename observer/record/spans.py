"""Which recordings there are of an axis, and from when to when each lasts."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

from observer.errors import LogError

_STAMPED = r"-\d{8}T\d{6}Z[^/]*\.csv"
"""How the recorder names a file after its machine and axis; what somebody has appended to it may stay."""
_LINE_BYTES = 1 << 16
_LATEST_S = 1e11  # the year 5138


@dataclass(frozen=True, slots=True)
class Recorded:
    """A file of a recording: its name, and the times of its first and last row in s since 1970."""

    path: Path
    from_s: float
    to_s: float


def recordings(folder: Path, name: str) -> list[Recorded]:
    """The files of an axis in the order of their time; raises `LogError` where the folder is not readable."""
    own = re.compile(re.escape(name) + _STAMPED)
    try:
        paths = sorted(
            path for path in folder.glob(f"{name}*") if own.fullmatch(path.name) and path.is_file()
        )
    except OSError as error:
        raise LogError(f"{folder}: cannot be read ({error.strerror}); fix record.directory") from None
    found = []
    for path in paths:
        try:
            times_s = ends(path)
        except OSError:
            continue  # it has been removed meanwhile
        if times_s is not None:
            found.append(Recorded(path, *times_s))
    return sorted(found, key=lambda recorded: recorded.from_s)


def ends(path: Path) -> tuple[float, float] | None:
    """The times of the first and of the last whole row, None where there are none. Raises `OSError`.

    Where a line that is too long hides the last row, the time of the last change stands for it.
    """
    with path.open("rb") as file:
        file.readline(_LINE_BYTES)
        first_s = _time(file.readline(_LINE_BYTES))
        file.seek(max(0, path.stat().st_size - _LINE_BYTES))
        for line in reversed(file.read(_LINE_BYTES).split(b"\n")[1:-1]):
            if first_s is not None and (last_s := _time(line)) is not None:
                return first_s, max(first_s, last_s)
        if first_s is None or file.tell() <= 2 * _LINE_BYTES:
            return None
        return first_s, max(first_s, path.stat().st_mtime)


def _time(line: bytes) -> float | None:
    """The time at the beginning of a row, None where there is none."""
    try:
        time_s = float(line.split(b",", 1)[0])
    except ValueError:
        return None
    return time_s if abs(time_s) <= _LATEST_S else None
