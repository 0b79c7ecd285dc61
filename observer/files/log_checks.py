"""Checks of a log: damaged blocks of a recording, times in another unit than seconds, text read as
missing.

A block of a recording is the bytes of whole rows. The `flags` cell of its last row ends with `#crc=` and the
CRC-32 of everything before it, back to the previous block. The first block includes the header.
"""

from __future__ import annotations

import re
import zlib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from observer.errors import LogError
from observer.frames import FloatArray

CHECKSUM = b"#crc="
DOUBTS, DOUBT_LINE = b"doubts", b"\n# doubt: "
"""Where a log has the doubts of its import: in the metadata of Parquet, in the last lines of a CSV."""
_BROKEN = re.compile(rb"#|crc=[0-9a-f]{8}\r?\n")
_MARK = re.compile(CHECKSUM + rb"([0-9a-f]{8})\r?\n")
LATEST_S = 1e11
"""The year 5138; an epoch in milliseconds is beyond it from 1973 on."""
_UNITS = ((1e17, "nanoseconds", 1e9), (1e14, "microseconds", 1e6), (LATEST_S, "milliseconds", 1e3))
"""Smallest time that must be in such a unit since 1970, and how many of them make a second."""
_WORDS = ("null", "none", "ovld", "ol", "o.l.", "overload", "overflow", "overrange", "over", "burnout",
          "open", "error", "unavailable", "unknown", "-", "--", "---", "----")  # fmt: skip
MISSING_WORDS = (
    *("NaN", "nan", "NAN", "NA", "N/A", "#N/A"),
    *dict.fromkeys(way(word) for word in _WORDS for way in (str.lower, str.upper, str.capitalize)),
)
"""Words that stand for a missing value; an infinite number is one as well."""
MISSING = frozenset(word.casefold() for word in (*MISSING_WORDS, "inf", "-inf", "nul", "n.a.", "*****"))
MOST_LISTED = 3
MOST_PROBLEMS = 10
_ANY = re.compile(
    rb"[,\n\"][ \t]*(?:[+-]?inf(?:inity)?|[+-]?nan|%s)[ \t]*(?=[,\r\n\"]|\Z)"
    % b"|".join(sorted({re.escape(word.lower().encode()) for word in MISSING_WORDS}, reverse=True)),
    re.IGNORECASE,
)


def damaged(data: bytes, *, has_header: bool = True) -> list[tuple[int, int]]:
    """Return where the rows of damaged blocks begin and end in the bytes of a recording, without the
    header.

    Rows after the last checksum, which a crash may leave, cannot be checked and pass. A recording without any
    checksum, of an older version, has no damaged blocks.

    Args:
        data: A recording, or a part of one that begins with a block.
        has_header: Whether the data begin with the header; only the first part does.

    Returns:
        Begin and end of each damaged block in bytes, in their order.
    """
    if CHECKSUM not in data:
        return []
    parts, start, header = [], 0, data.find(b"\n") + 1 if has_header else 0
    view = memoryview(data)
    for mark in _MARK.finditer(data):
        if zlib.crc32(view[start : mark.start()]) != int(mark[1], 16):
            parts.append((max(start, header), mark.end()))
        start = mark.end()
    if _BROKEN.search(data, max(start, header)):  # a checksum that is itself no longer one
        parts.append((max(start, header), len(data)))
    return parts


def without(data: bytes, parts: Sequence[tuple[int, int]]) -> bytes:
    """Return the bytes without some parts, given by begin and end in their order."""
    pieces, at = [], 0
    for start, end in parts:
        pieces.append(data[at:start])
        at = end
    return b"".join([*pieces, data[at:]])


def without_doubts(data: bytes) -> tuple[bytes, tuple[str, ...]]:
    """Return the bytes of a CSV without the lines of doubts that `observer import` wrote at its end, and
    the doubts.

    Other comments at the end stay, for the reader to refuse.
    """
    at = data.find(DOUBT_LINE)
    if at < 0:
        return data, ()
    lines = data[at + 1 :].decode("utf-8", "replace").split("\n")
    mark = DOUBT_LINE.decode().strip()
    if not all(line.startswith(mark) for line in lines if line.strip()):
        return data, ()
    return data[: at + 1], tuple(line.removeprefix(mark).strip() for line in lines if line.strip())


def doubts_in(metadata: bytes) -> tuple[str, ...]:
    """Return the doubts that `observer import` wrote into the metadata of a Parquet file."""
    return tuple(line for line in metadata.decode("utf-8", "replace").split("\n") if line)


def rows_of(data: bytes, part: tuple[int, int]) -> str:
    """Return the rows of a part in words, counted from 1, with their lines, counted with the header."""
    first = data.count(b"\n", 0, part[0]) + 1
    last = max(first, data.count(b"\n", 0, part[1]))
    return f"rows {first - 1} to {last - 1} (lines {first} to {last})"


def refuse_other_units(path: Path, column: str, time_s: FloatArray, rows_apart_s: float) -> None:
    """Refuse times that are not in seconds.

    Args:
        path: The log, named in errors.
        column: The column of times, named in errors.
        time_s: Increasing times (n,).
        rows_apart_s: Largest usual distance of rows; a log in milliseconds exceeds it.

    Raises:
        LogError: The times are an epoch in another unit, or half of the rows are further apart.
    """
    last_s = float(np.max(np.abs(time_s)))
    for least, unit, per_s in _UNITS:
        if last_s > least:
            raise LogError(
                f"{path}: {column} says {last_s:.6g}, which looks like {unit} since 1970 where seconds are "
                f"expected; divide the column by {per_s:.0e}".replace("e+0", "e")
            )
    apart_s = float(np.median(np.diff(time_s))) if len(time_s) > 1 else 0.0
    lasts_s = float(time_s[-1] - time_s[0])
    if apart_s > rows_apart_s:
        raise LogError(
            f"{path}: by {column} the rows are {duration_words(apart_s)} apart and the log lasts "
            f"{duration_words(lasts_s)}, which looks like milliseconds where seconds are "
            f"expected; divide the column by 1000, or, if they really are so far apart, "
            f"set [log] rows_apart_s = {1.5 * apart_s:.2g} in the configuration"
        )


def duration_words(time_s: float) -> str:
    """Return a length of time in the largest unit of which it has two."""
    for unit_s, unit in ((86_400.0, "days"), (3600.0, "h"), (60.0, "min")):
        if time_s >= 2.0 * unit_s:
            return f"{time_s / unit_s:.3g} {unit}"
    return f"{time_s:.3g} s"


@dataclass(frozen=True, slots=True)
class Words:
    """Cells of a column that hold words and were read as missing.

    Attributes:
        column: The column, or its channel.
        cells: Their number.
        texts: The different words, the most frequent first.
    """

    column: str
    cells: int
    texts: tuple[str, ...]

    @property
    def text(self) -> str:
        """The words as a sentence without full stop, with the remedy."""
        say, read = ("cell says", "was read") if self.cells == 1 else ("cells say", "were read")
        words = ", ".join(self.texts[:MOST_LISTED]) + (", …" if len(self.texts) > MOST_LISTED else "")
        return (
            f"channel {self.column}: {self.cells} {say} {words} and {read} as missing; check why the "
            "recorder wrote that, and leave missing cells empty"
        )


def words_in(
    data: bytes, header: Sequence[str], columns: Mapping[str, FloatArray], missing: Sequence[str] = ()
) -> tuple[Words, ...]:
    """Return the words in the text of a CSV, a record for each column that has some.

    Args:
        data: The text.
        header: Names of all its columns.
        columns: The numbers (n,) that columns were read as, NaN for a missing one.
        missing: Words besides `MISSING_WORDS`.
    """
    if not (
        incomplete := {name: values for name, values in columns.items() if not np.isfinite(values).all()}
    ):
        return ()
    if not missing and _ANY.search(data, max(data.find(b"\n"), 0)) is None:
        return ()
    import pyarrow as pa  # noqa: PLC0415 - slow to import, and the daemon reads no log
    from pyarrow import csv as pa_csv  # noqa: PLC0415

    table = pa_csv.read_csv(
        pa.py_buffer(data),
        read_options=pa_csv.ReadOptions(column_names=list(header), skip_rows=1),
        convert_options=pa_csv.ConvertOptions(
            column_types=dict.fromkeys(incomplete, pa.string()), include_columns=list(incomplete)
        ),
    )
    by_channel = (
        _unreadable(name, table.column(name), ~np.isfinite(values)) for name, values in incomplete.items()
    )
    return tuple(words for words in by_channel if words.cells)


def _unreadable(name: str, texts: Any, missing: Any) -> Words:
    import pyarrow as pa  # noqa: PLC0415
    import pyarrow.compute as pc  # noqa: PLC0415

    cells = pc.utf8_trim_whitespace(texts.filter(pa.array(missing)))
    counts = {entry["values"]: entry["counts"] for entry in pc.value_counts(cells).to_pylist()}
    counts.pop("", None)
    return Words(name, sum(counts.values()), tuple(sorted(counts, key=lambda word: (-counts[word], word))))


def infinite_in(columns: Mapping[str, FloatArray]) -> tuple[Words, ...]:
    """Return the counts of infinite numbers, which stand for missing values, in columns (n,) of numbers."""
    counts = {name: int(np.isinf(values).sum()) for name, values in columns.items()}
    return tuple(Words(name, count, ("inf",)) for name, count in counts.items() if count)


def several(path: Path | str, problems: Iterable[str]) -> LogError:
    """Return the error that names the problems of a file: the first ten, and how many more there are.

    Args:
        path: The file.
        problems: Sentences without the file's name; repeated ones count once.
    """
    first, not_listed = list[str](), 0
    for problem in problems:  # a file may have millions
        if problem in first:
            continue
        if len(first) < MOST_PROBLEMS:
            first.append(problem)
        else:
            not_listed += 1
    if len(first) == 1:
        return LogError(f"{path}: {first[0]}")
    lines = [f"  {problem}" for problem in first]
    if not_listed:
        lines.append(f"  and {not_listed} more; fix these first")
    return LogError("\n".join([f"{path}: {len(first) + not_listed} problems:", *lines]))
