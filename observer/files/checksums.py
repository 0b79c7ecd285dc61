"""The checksums of a recording: which of its blocks are no longer as they were written.

A block is the bytes of whole rows; the `flags` cell of its last row ends with `#crc=` and the CRC-32 of all
before it, back to the block before; that of the first block counts the header in.
"""

from __future__ import annotations

import re
import zlib
from collections.abc import Sequence

CHECKSUM = b"#crc="
_BROKEN = re.compile(rb"#|crc=[0-9a-f]{8}\r?\n")
_MARK = re.compile(CHECKSUM + rb"([0-9a-f]{8})\r?\n")


def damaged(data: bytes) -> list[tuple[int, int]]:
    """Where the rows of damaged blocks begin and end in the bytes of a recording; the header is no row.

    Rows after the last checksum, which a crash may leave, cannot be told and pass. A recording without any
    checksum, of an older version, has no damaged blocks.
    """
    if CHECKSUM not in data:
        return []
    found, start, header = [], 0, data.find(b"\n") + 1
    view = memoryview(data)
    for mark in _MARK.finditer(data):
        if zlib.crc32(view[start : mark.start()]) != int(mark[1], 16):
            found.append((max(start, header), mark.end()))
        start = mark.end()
    if _BROKEN.search(data, max(start, header)):  # a checksum that is itself no longer one
        found.append((max(start, header), len(data)))
    return found


def without(data: bytes, parts: Sequence[tuple[int, int]]) -> bytes:
    """The bytes without some parts, given in their order."""
    kept, at = [], 0
    for start, end in parts:
        kept.append(data[at:start])
        at = end
    return b"".join([*kept, data[at:]])


def rows_of(data: bytes, part: tuple[int, int]) -> str:
    """Which rows a part is, as a reader counts: rows from 1, lines with the header."""
    first = data.count(b"\n", 0, part[0]) + 1
    last = max(first, data.count(b"\n", 0, part[1]))
    return f"rows {first - 1} to {last - 1} (lines {first} to {last})"
