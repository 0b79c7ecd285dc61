"""One file of a recording: straight to the system, for its owner only, each block with a checksum.

A block is the rows of one write. The `flags` cell of its last row ends with `#crc=` and the CRC-32 of all
bytes since the block before, the first block's with the header. A `#` cannot be part of a channel's name or
fault there, so older readers pass over it.
"""

from __future__ import annotations

import fcntl
import os
import zlib
from contextlib import suppress
from datetime import UTC, datetime
from pathlib import Path

from observer.files.checksums import CHECKSUM
from observer.files.folders import OWNER_ONLY, make_folder, write_whole

START_SUFFIX = ".start"
"""The checkpoint beside a recording, from which its estimates start, has the recording's name and this."""


class Part:
    """The file that is being written, if any; a refused write leaves no part of a row."""

    def __init__(self) -> None:
        self.path: Path | None = None
        self.size = 0
        self._fd = -1
        self._crc = 0

    def open(self, directory: Path, name: str, first: bytes, start: bytes | None = None) -> None:
        """Begin a file named by `name` and the time in UTC with the line `first`; `start` goes beside it."""
        make_folder(directory)
        stamp = f"{datetime.now(UTC):%Y%m%dT%H%M%SZ}"
        for number in range(1, 1000):
            part = f"-{number}" if number > 1 else ""
            path = directory / f"{name}-{stamp}{part}.csv"
            try:
                self._fd = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, OWNER_ONLY)
            except FileExistsError:
                continue
            break
        self.path, self.size = path, 0
        try:
            with suppress(OSError):  # a file system without locks: the name alone keeps it apart
                fcntl.flock(self._fd, fcntl.LOCK_EX | fcntl.LOCK_NB)
            if start is not None:
                write_whole(path.with_suffix(START_SUFFIX), start)
            self._write(first)
        except OSError:
            self.close()
            path.unlink(missing_ok=True)
            raise
        self._crc = zlib.crc32(first)

    def write(self, rows: bytes) -> None:
        """Append rows as a block, all of it or, as far as the file can be cut back, nothing."""
        body = rows[:-1] if rows.endswith(b",\n") else rows[:-1] + b";"
        self._write(body + CHECKSUM + f"{zlib.crc32(body, self._crc):08x}\n".encode())
        self._crc = 0

    def _write(self, data: bytes) -> None:
        try:
            rest = memoryview(data)
            while rest:
                rest = rest[os.pwrite(self._fd, rest, self.size + len(data) - len(rest)) :]
        except OSError:
            os.ftruncate(self._fd, self.size)
            raise
        self.size += len(data)

    @property
    def is_gone(self) -> bool:
        """Whether somebody has deleted the file, so that what goes into it would be lost."""
        return self.path is not None and os.fstat(self._fd).st_nlink == 0

    def sync(self) -> None:
        """Have everything on the disk."""
        if self.path is not None:
            os.fsync(self._fd)

    def close(self) -> None:
        """End the file, if there is one."""
        if self.path is not None:
            os.close(self._fd)
            self.path = None
