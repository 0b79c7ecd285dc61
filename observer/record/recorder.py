"""The lossless recording: one row per reading and one per tick, in the order in which they were used.

A thread of its own writes, so a slow or full disk never holds up the loop. Rows wait in memory while the disk
refuses them; beyond a bound they are dropped and counted.
"""

from __future__ import annotations

import csv
import fcntl
import io
import math
import os
import threading
import time
import zlib
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, NamedTuple
from urllib.parse import quote

import structlog

from observer.align.aligner import COMMAND_MARK, MISSING_FAULT
from observer.files.folders import OWNER_ONLY, make_folder, write_whole
from observer.files.log_checks import CHECKSUM
from observer.files.logs import FLAGS, LATE, STEP, TIME
from observer.frames import Reading
from observer.record.retention import (
    CONFIG_SUFFIX,
    START_SUFFIX,
    STATE_SUFFIX,
    TRUSTED_AFTER_S,
    Retention,
    sealed,
    shortage,
    tidy,
)

_CAPACITY_ROWS = 100_000
_BATCH_S = 0.2
_RETRY_S = 1.0
_TIDY_S = 60.0
_PLAIN = "()[]/:+ "

log = structlog.get_logger()


@dataclass(frozen=True, slots=True)
class RecordStatus:
    """The state of a recording.

    Attributes:
        path: The file that is being written; None before the first row.
        rows_written: Rows handed to the system so far.
        rows_dropped: Rows lost so far, since the disk refused them for too long.
        reason: A sentence about what is wrong, with the remedy; None while all is well.
    """

    path: Path | None = None
    rows_written: int = 0
    rows_dropped: int = 0
    reason: str | None = None


class Companions(NamedTuple):
    """The files beside a recording.

    Attributes:
        start: The checkpoint from which the service started; None after a cold start.
        config: The document of the configuration in force; None for none.
        pack: Makes the state after the last tick of a full file from what `tick` got; None for no such file.
    """

    start: bytes | None = None
    config: bytes | None = None
    pack: Callable[[Any], bytes] | None = None


class Recorder:
    """Writes readings and ticks to CSV files named by machine, axis and UTC start.

    Each file can be read alone: when it has grown to `rotate_bytes` the next tick is its last row. All rows
    are handed to the system at least every 0.2 s and to the disk at least every `sync_s`. Beside the first
    file goes the start of `companions`, beside each file its configuration. Beside each that follows a full
    one goes the state after that one's last tick. `keep` removes old files.

    The methods never block and never raise: rows wait in memory, up to 100,000, and further ones are dropped
    and counted. They are for the thread of the loop.
    """

    def __init__(
        self,
        directory: Path,
        name: str,
        channels: Sequence[str],
        rotate_bytes: float,
        sync_s: float,
        keep: Retention | None = None,
        companions: Companions = Companions(),  # noqa: B008 (it is frozen)
    ) -> None:
        start, config, self._pack = companions
        self._directory = directory
        self._name = name
        self._channels = tuple(channels)
        self._rotate_bytes = rotate_bytes
        self._sync_s = sync_s
        self._keep = keep
        self._always = {} if config is None else {CONFIG_SUFFIX: sealed(config)}
        self._beside = self._always if start is None else {START_SUFFIX: start, **self._always}
        self._first = header(self._channels)
        self._size = len(self._first)  # of the file that the next row goes into, without checksums
        self._queue: deque[_Row] = deque()
        self._held: list[_Row] = []  # taken from the queue, not yet written
        self._dropped = 0
        self._file = Part()
        self._written = 0
        self._refused: str | None = None
        self._shortage: str | None = None
        self._begun_s = time.monotonic()
        self._tidied_s = -math.inf
        self._closing = threading.Event()
        self._thread = threading.Thread(target=self._supervised, name="recorder", daemon=True)
        self._thread.start()

    @property
    def status(self) -> RecordStatus:
        """The state of the recording; from any thread."""
        reason = self._refused or self._shortage
        return RecordStatus(self._file.path, self._written, self._dropped, reason)

    @property
    def alive(self) -> bool:
        """Whether the thread that writes is running; without it nothing is recorded."""
        return self._thread.is_alive()

    def reading(self, reading: Reading) -> None:
        """Record a reading as the aligner uses it, in a row with its values, faults and delay."""
        self._put(row_of_reading(reading, self._channels))

    def tick(self, time_s: float, standing: Callable[[], Any] | None = None) -> None:
        """Record a tick.

        Args:
            time_s: Its time, s since 1970.
            standing: Returns the state of the service after it; called only where a file ends with this tick.
        """
        row = f"{time_s!r},{',' * len(self._channels)}1,,\n".encode()
        is_full = self._size + len(row) >= self._rotate_bytes
        self._put(row, is_full, standing() if is_full and standing is not None else None)

    def command(self, time_s: float, name: str, outcome: str) -> None:
        """Record a command and its outcome in a row without any value.

        Args:
            time_s: When it was executed.
            name: The command.
            outcome: Its outcome in words.
        """
        entry = f"{COMMAND_MARK}{name}={quote(outcome, safe=_PLAIN)}"
        self._put(f"{time_s!r},{',' * len(self._channels)},,{entry}\n".encode())

    def close(self, timeout_s: float = 1.0) -> bool:
        """Write the rows that wait, and end the thread.

        Returns:
            Whether all rows reached the disk within `timeout_s`.
        """
        self._closing.set()
        self._thread.join(timeout_s)
        return not self._thread.is_alive() and not self._queue and not self._held

    def _put(self, data: bytes, is_last: bool = False, standing: Any = None) -> None:
        if len(self._queue) + len(self._held) >= _CAPACITY_ROWS:
            self._dropped += 1
        else:
            self._queue.append(_Row(data, is_last, standing))
            self._size = len(self._first) if is_last else self._size + len(data)

    def _supervised(self) -> None:
        """Write until closed; a defect in here is reported and ends the thread, which `alive` shows."""
        try:
            self._run()
        except Exception as error:  # whatever it is, health and watchdog are to know
            self._refused = f"the thread that writes has ended ({error!r}); restart the service"
            log.error("recorder ended", exc_info=True)

    def _run(self) -> None:
        synced_s = time.monotonic()
        while True:
            closing = self._closing.wait(_BATCH_S if self._refused is None else _RETRY_S)
            try:
                self._drain()
                if closing or time.monotonic() - synced_s >= self._sync_s:
                    self._file.sync()
                    synced_s = time.monotonic()
                self._refused = None
            except OSError as error:
                place = self._file.path or self._directory
                self._refused = f"{place}: cannot be written ({error.strerror}); free space or repair it"
            if closing:
                self._file.close()
                return
            self._tidy()

    def _drain(self) -> None:
        """Write the rows that wait, a file at a time; a row leaves the queue once the system has it."""
        for _ in range(len(self._queue)):
            self._held.append(self._queue.popleft())
        if self._held and self._file.is_gone:
            self._file.close()
        while self._held:
            if self._file.path is None:
                self._file.open(self._directory, self._name, self._first, self._beside)
                self._beside = self._always
            end = next((i for i, row in enumerate(self._held) if row.is_last), None)
            last, count = (None, len(self._held)) if end is None else (self._held[end], end + 1)
            self._file.write(b"".join(row.data for row in self._held[:count]))
            self._written += count
            del self._held[:count]
            if last is not None:
                if last.standing is not None and self._pack is not None:
                    self._beside = {STATE_SUFFIX: self._pack(last.standing), **self._always}
                self._file.sync()
                self._file.close()
                self._tidied_s = -math.inf

    def _tidy(self) -> None:
        """Look after age, size and free space now and then, and whenever a file is full."""
        now_s = time.monotonic()
        if self._keep is None or self._file.path is None or now_s - self._tidied_s < _TIDY_S:
            return
        self._tidied_s = now_s
        try:
            trusted = now_s - self._begun_s >= TRUSTED_AFTER_S
            for path in tidy(self._directory, self._name, self._keep, time.time(), by_age=trusted):
                log.info("recording removed", path=str(path))
            self._shortage = shortage(self._directory, self._keep)
        except OSError as error:
            self._shortage = f"{self._directory}: cannot be cleaned up ({error.strerror}); repair it"


class _Row(NamedTuple):
    """A row, whether a file ends with it, and where the service stood then, None where that is not known."""

    data: bytes
    is_last: bool
    standing: Any


class NoRecorder:
    """Records nothing, for a service without recordings; it has the methods of `Recorder`."""

    alive, status = True, None

    def reading(self, reading: Reading) -> None:
        """Leave a reading out."""

    def tick(self, time_s: float, _standing: Callable[[], Any] | None = None) -> None:
        """Leave a tick out."""

    def command(self, time_s: float, name: str, outcome: str) -> None:
        """Leave a command out."""

    def close(self, _timeout_s: float = 1.0) -> bool:
        """Return True at once."""
        return True


def header(channels: Sequence[str]) -> bytes:
    """Return the first line of a recording: `time_s`, the channels, `step`, `late_s`, `flags`."""
    line = io.StringIO()
    csv.writer(line, lineterminator="\n").writerow([TIME, *channels, STEP, LATE, FLAGS])
    return line.getvalue().encode()


def row_of_reading(reading: Reading, channels: Sequence[str]) -> bytes:
    """Return a reading as a row: the shortest decimals that read back to the same bits, faults by channel.

    A channel that the reading lacks, and a NaN, are empty cells; only the NaN has a fault in `flags`.
    """
    values = [reading.values.get(name, math.nan) for name in channels]
    cells = [repr(reading.time_s), *("" if math.isnan(value) else repr(value) for value in values)]
    late = repr(reading.late_s) if reading.late_s else ""
    return f"{','.join(cells)},,{late},{flags_of(reading, channels)}\n".encode()


def flags_of(reading: Reading, channels: Sequence[str]) -> str:
    """Return the faults of a reading as a `flags` cell: `channel=fault`, separated by semicolons.

    A value that is missing without a fault is one too. Names and faults are quoted as in a URL.
    """
    flags = []
    for name in channels:
        if name in reading.values:
            missing = MISSING_FAULT if math.isnan(reading.values[name]) else None
            if fault := reading.faults.get(name) or missing:
                flags.append(f"{quote(name, safe=_PLAIN)}={quote(fault, safe=_PLAIN)}")
    return ";".join(flags)


class Part:
    """The file that is being written, if any; a refused write leaves no part of a row.

    Attributes:
        path: The file; None between two files.
        size: Its size in bytes.
    """

    def __init__(self) -> None:
        self.path: Path | None = None
        self.size = 0
        self._fd = -1
        self._crc = 0

    def open(self, directory: Path, name: str, first: bytes, companions: Mapping[str, bytes]) -> None:
        """Begin a file named by `name` and the time in UTC, and lock it.

        Args:
            directory: Is made if it is missing.
            name: `<machine>-<axis>`.
            first: The header.
            companions: Content of the files beside it, by suffix.

        Raises:
            OSError: A file cannot be written; then no recording is left behind.
        """
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
            for suffix, data in companions.items():
                write_whole(path.with_suffix(suffix), data)
            self._write(first)
        except OSError:
            self.close()
            path.unlink(missing_ok=True)
            raise
        self._crc = zlib.crc32(first)

    def write(self, rows: bytes) -> None:
        """Append rows as a block with its checksum, all of it or, as far as the file can be cut back,
        nothing.

        Args:
            rows: Whole lines.

        Raises:
            OSError: The disk refuses them.
        """
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
        """Whether somebody has deleted the file, so that rows written into it would be lost."""
        return self.path is not None and os.fstat(self._fd).st_nlink == 0

    def sync(self) -> None:
        """Return once everything is on the disk.

        Raises:
            OSError: The disk refuses it.
        """
        if self.path is not None:
            os.fsync(self._fd)

    def close(self) -> None:
        """Close the file, if there is one, and release its lock."""
        if self.path is not None:
            os.close(self._fd)
            self.path = None
