"""An extract of a log that a user can send to support: its first and last lines, and how they were read."""

from __future__ import annotations

import gzip
import zlib
from collections.abc import Iterator, Sequence
from itertools import islice
from pathlib import Path

import numpy as np

from observer.config.logs import Logs
from observer.errors import LogError, UserError
from observer.intake.readers.text import encoding_of
from observer.intake.sheets import RawColumn, full_name
from observer.intake.sources import Sources, sources_of

MOST_BYTES = 19_500
"""Of an extract; its readers promise less than 20 kB."""
_HEAD, _TAIL = 65_536, 8_192
_FIRST_LINES, _LAST_LINES, _LONGEST_LINE = 30, 8, 300
_MOST_COLUMNS, _SHOWN_ROWS = 60, 3
_MOST_BINARY = 512


def extract_of(paths: Sequence[Path], options: Logs) -> str:
    """Return the extract of files, as text of less than 20 kB: first and last lines, and how they were
    read.

    Paths are reduced to a file's name. A file that cannot be understood is part of the extract, with its
    error.

    Args:
        paths: Files, which share the size equally.
        options: The `[log]` table by which they are read.

    Raises:
        LogError: A file cannot be opened.
    """
    share = MOST_BYTES // len(paths)
    return "\n".join(_shortened("\n".join(_extract(path, options)), share) for path in paths) + "\n"


def _extract(path: Path, options: Logs) -> Iterator[str]:
    """Yield the lines of the extract of one file."""
    try:
        size = path.stat().st_size
        head, tail = _ends(path)
    except OSError as error:
        raise LogError(f"{path}: cannot be read ({error.strerror}); give a readable log") from None
    yield f"extract of {path.name!r}, {size} bytes"
    yield from (f"read as: {line}" for line in islice(_reading_of_file(path, options), 4 * _MOST_COLUMNS))
    if _is_text(head):
        encoding = options.encoding or encoding_of(head)
        yield f"first lines, in {encoding}:"
        first = head.decode(encoding, "replace").splitlines()
        yield from map(_escaped, first[:_FIRST_LINES])
        last = tail.decode(encoding, "replace").splitlines()[1:]
        if last:
            yield "last lines:"
            yield from map(_escaped, last[-_LAST_LINES:])
    else:
        yield f"first bytes: {head[:_MOST_BINARY]!r}"


def _ends(path: Path) -> tuple[bytes, bytes]:
    """Return the first bytes of a file, decompressed, and its last ones if they are not among the first."""
    with path.open("rb") as file:
        head = file.read(_HEAD)
        if not head.startswith(b"\x1f\x8b"):
            at = max(len(head), path.stat().st_size - _TAIL)
            file.seek(at - at % 4)  # a whole character of UTF-16 and UTF-32
            return head, file.read(_TAIL)
    try:
        with gzip.open(path) as file:
            return file.read(_HEAD), b""
    except (OSError, EOFError, zlib.error):
        return head, b""


def _is_text(head: bytes) -> bool:
    """Whether bytes are text; in UTF-16 every other byte is 0."""
    sample = head[:4096]
    strange = sum(octet < 9 or 13 < octet < 32 for octet in sample)
    is_utf16 = sample.startswith((b"\xff\xfe", b"\xfe\xff")) or sample[1::2].count(0) > 0.4 * len(sample)
    binary = sample.startswith((b"PK", b"PAR1", b"MDF", b"TDSm", b"ARROW1"))
    return not binary and (is_utf16 or strange < 0.02 * len(sample))


def _reading_of_file(path: Path, options: Logs) -> Iterator[str]:
    """Yield how the reader understands a file: its tables, clocks and columns, or its error."""
    try:
        sources = sources_of([path], options)
    except (UserError, ModuleNotFoundError) as error:
        yield str(error).replace(str(path), path.name)
        return
    yield from (f"problem: {sentence}" for sentence in sources.problems[:10])
    yield from (f"doubt: {sentence}" for sentence in sources.doubts[:10])
    for sheet in sources.without:
        yield f"table {sheet.name!r} without a clock"
        yield from map(_column, sheet.columns[:_MOST_COLUMNS])
    yield from _timed_tables(sources)


def _timed_tables(sources: Sources) -> Iterator[str]:
    """Yield a line for each table with a clock, and one for each of its columns."""
    for source in sources.timed:
        clock, time_s = source.clock, source.clock.time_s
        since = "since 1970" if clock.since_1970 else "from a beginning"
        ends = f"{time_s[0]:.6f} … {time_s[-1]:.6f}" if len(time_s) else "none"
        yield (
            f"table {source.sheet.name!r}: {len(time_s)} rows, time {' and '.join(map(repr, clock.columns))} "
            f"in {clock.unit or 'dates'}, s {since}: {ends}"
        )
        yield from map(_column, source.sheet.columns[:_MOST_COLUMNS])


def _column(column: RawColumn) -> str:
    """Return one line about a column: its name, kind, and first and last cells."""
    kind = "text" if column.is_text else "dates" if column.is_moments else "numbers"
    first, last = column.values[:_SHOWN_ROWS], column.values[-_SHOWN_ROWS:]
    cells = [*first, *last] if isinstance(first, np.ndarray) else [*first.to_pylist(), *last.to_pylist()]
    return _escaped(f"column {full_name(column)!r}, {kind}: " + ", ".join(str(cell) for cell in cells))


def _escaped(line: str) -> str:
    """Return a line without control characters, cut where it is long."""
    shown = "".join(c if c.isprintable() or c == "\t" else repr(c)[1:-1] for c in line[:_LONGEST_LINE])
    return shown if len(line) <= _LONGEST_LINE else f"{shown} … ({len(line)} characters)"


def _shortened(text: str, limit: int) -> str:
    """Return a text of at most `limit` bytes of UTF-8, its middle left out."""
    data = text.encode("utf-8", "replace")
    if len(data) <= limit:
        return text
    half = limit // 2 - 20
    return "\n[…]\n".join(part.decode("utf-8", "ignore") for part in (data[:half], data[-half:]))
