"""Estimates and readings between two times, from the recordings: replayed, never kept a second time.

A recording is replayed by the configuration it was made under, from the state beside it, so its estimates are
those that were published, to the last bit. Exceptions are described in a note. A replay keeps its states
along the way in memory: the next query about the same hours begins there.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from observer.align.aligner import blocks_of_log
from observer.align.walk import Memory, Walk
from observer.archive.parts import parts
from observer.errors import LogError, UserError
from observer.estimate.checkpoint import CheckpointFit
from observer.estimate.pipeline import MachineModel, Pipeline
from observer.estimate.replay import start_of
from observer.files.logs import Log
from observer.frames import EstimateBlock, FrameBlock
from observer.installation import Installation, parse
from observer.record.recent import one_log
from observer.record.retention import CONFIG_SUFFIX, recorded_config
from observer.record.spans import Recorded, recordings

_MOST_STANDS = 400
_MOST_SETUPS = 4


class UnfinishedError(UserError):
    """A query took too long; what was read is remembered, so the next one continues from there."""


@dataclass(frozen=True, slots=True)
class Origin:
    """Where estimates come from: the file, the service's `instance`, and the hashes of two configurations.

    It was `recorded` under one of them, None where that is not known, and the other is `used`.
    """

    path: Path
    instance: str
    recorded: str | None
    used: str


@dataclass(frozen=True, slots=True)
class Chapter:
    """Some steps of the past: their frames, estimates, numbers (K,) and origin; which of them are `wanted`.

    `estimates` are None where they were not asked for.
    """

    frames: FrameBlock
    estimates: EstimateBlock | None
    sequence: NDArray[np.int64]
    origin: Origin
    wanted: NDArray[np.intp]


@dataclass(frozen=True, slots=True)
class _Setup:
    machine: MachineModel
    fit: CheckpointFit
    digest: str


@dataclass(frozen=True, slots=True)
class _Stand:
    """The state of a replay at the end of a part: `end` in the file, rows after the last tick as `rest`."""

    end: int
    last_s: float
    rest: Log | None
    sequence: int
    memory: Memory
    state: tuple[Any, ...]


class Archive:
    """The recordings of an axis, queried by time. `digest` is the hash of `config`, the one in force."""

    def __init__(
        self, config: Installation, digest: str, clock: Callable[[], float] = time.monotonic
    ) -> None:
        self._config, self._digest, self._clock = config, digest, clock
        self._name = f"{config.machine.name}-{config.machine.axis}"
        self._setups: dict[str, _Setup] = {}
        self._stands: dict[tuple[Path, int, int], _Stand] = {}

    @property
    def in_force(self) -> str:
        """The hash of the configuration in force."""
        return self._digest

    def setup(self, digest: str) -> MachineModel:
        """The machine of a configuration that was used."""
        return self._setups[digest].machine

    def files(self) -> list[Recorded]:
        """The recordings there are; raises `LogError` without a folder or where it cannot be read."""
        if self._config.record.directory is None:
            raise LogError("nothing is recorded; name a folder in record.directory")
        return recordings(self._config.record.directory, self._name)

    def read(
        self,
        from_s: float,
        to_s: float,
        notes: list[str],
        *,
        estimates: bool = True,
        until_s: float = math.inf,
    ) -> Iterator[Chapter]:
        """The steps from one time to another, in order; `notes` gets remarks, a sentence each.

        Raises `LogError` where nothing can be read, `UnfinishedError` where the clock is past `until_s`
        before the span is reached.
        """
        files, last_s = self.files(), -math.inf
        for number, file in enumerate(files):
            if file.to_s < from_s or file.from_s >= to_s:
                continue
            before = files[number - 1] if number else None
            try:
                for chapter in self._file(file, before, from_s, to_s, notes, estimates, until_s):
                    time_s = chapter.frames.time_s
                    wanted = np.flatnonzero((time_s >= from_s) & (time_s < to_s) & (time_s > last_s))
                    if len(wanted):
                        last_s = float(time_s[wanted[-1]])
                        yield replace(chapter, wanted=wanted)
            except (LogError, OSError) as error:
                reason = error.strerror if isinstance(error, OSError) else error
                _note(notes, f"{file.path.name} is left out: {reason}")

    def _file(
        self,
        file: Recorded,
        before: Recorded | None,
        from_s: float,
        to_s: float,
        notes: list[str],
        estimates: bool,
        until_s: float,
    ) -> Iterator[Chapter]:
        """The steps of a file around a span."""
        setup, origin = self._known(file.path, notes)
        plan, inode = setup.machine.plan, file.path.stat().st_ino
        machine = setup.machine
        pipeline = Pipeline(
            machine.drive, machine.estimator(), machine.self_test(), occasional=machine.occasional
        )
        stand = self._stand(file.path, inode, from_s)
        if stand is not None:
            walk = Walk(plan.channels, plan.expected(), memory=stand.memory)
            pipeline.restore(*stand.state)
            begin, rest, sequence = stand.end, stand.rest, stand.sequence
        else:
            walk, sequence = self._begin(file, before, setup, pipeline, notes)
            begin, rest = 0, None
        size = max(1, file.path.stat().st_size)
        for part in parts(file.path, plan.channels, begin):
            if part.lost is not None:
                _note(notes, f"{part.lost}; the sequence numbers after them are too small")
            log = part.log if rest is None else rest if part.log is None else one_log(rest, part.log)
            if log is None:
                continue
            last_s = float(walk.memory.last_tick_s[0])
            for frames, afresh in blocks_of_log(log, plan, walk=walk):
                if afresh:
                    pipeline.reset()
                found = pipeline.step(frames) if estimates else None
                count = np.arange(len(frames)) + sequence
                sequence += len(frames)
                last_s = float(frames.time_s[-1])
                yield Chapter(frames, found, count, origin, np.empty(0, np.intp))
            rest = _rest(log)
            if estimates and math.isfinite(last_s):
                state = (*pipeline.snapshot()[:2], None, pipeline.test_state)
                self._keep(
                    file.path, inode, _Stand(part.end, last_s, rest, sequence, walk.memory.copy(), state)
                )
            if last_s >= to_s:
                return
            if last_s < from_s and self._clock() > until_s:
                raise UnfinishedError(
                    f"{file.path.name} has been read up to {part.end / size:.0%}; ask again to continue"
                )

    def _begin(
        self,
        file: Recorded,
        before: Recorded | None,
        setup: _Setup,
        pipeline: Pipeline[Any],
        notes: list[str],
    ) -> tuple[Walk, int]:
        """The state at the beginning of a file: the one stored beside it, or cold, which is noted where it
        continues another.
        """
        plan, instance = setup.machine.plan, _instance(file.path)
        first = Log(file.path, np.array([file.from_s]), (), np.empty((1, 0)), np.zeros(1, np.bool_))
        start, words = start_of(first, setup.fit)
        is_first = instance is not None and (before is None or _instance(before.path) != instance)
        if not is_first and (start is None or start.walk is None):
            _note(notes, f"{file.path.name}: sequence numbers start again")
        if start is None:
            if not is_first or words != "cold":
                _note(notes, f"{file.path.name}: estimates start {words}")
            return Walk(plan.channels, plan.expected()), 0
        pipeline.restore(start.drive, start.estimator, None, start.test)
        return Walk(plan.channels, plan.expected(), start.tick_s, start.walk), start.sequence

    def _known(self, path: Path, notes: list[str]) -> tuple[_Setup, Origin]:
        """The configuration for replaying a recording: the one it was made under, where that is kept."""
        document = recorded_config(path)
        digest = document.get("hash")
        if digest is None:
            _note(notes, f"{path.name}: its configuration was not kept; estimated by the one in force")
        elif digest != self._digest:
            try:
                setup = self._setup(digest, lambda: parse(document["config"], path.stem + CONFIG_SUFFIX))
                doubt = "" if "checksum" in document else ", which has no checksum"
                _note(notes, f"{path.name}: recorded and estimated under configuration {digest}{doubt}")
                return setup, Origin(path, str(document.get("instance", "")), digest, digest)
            except UserError as error:
                _note(
                    notes,
                    f"{path.name}: its configuration {digest} cannot be used ({error}); estimated by the "
                    "one in force",
                )
        setup = self._setup(self._digest, lambda: self._config)
        return setup, Origin(path, str(document.get("instance", "")), digest, self._digest)

    def _setup(self, digest: str, config: Callable[[], Installation]) -> _Setup:
        if digest not in self._setups:
            machine = MachineModel.of(config(), learns=True)
            while len(self._setups) >= _MOST_SETUPS:
                del self._setups[next(iter(self._setups))]
            self._setups[digest] = _Setup(machine, CheckpointFit.of(machine), digest)
        return self._setups[digest]

    def _stand(self, path: Path, inode: int, from_s: float) -> _Stand | None:
        """The last known state in a file before a time."""
        own = (s for (p, i, _), s in self._stands.items() if (p, i) == (path, inode) and s.last_s < from_s)
        return max(own, key=lambda stand: stand.end, default=None)

    def _keep(self, path: Path, inode: int, stand: _Stand) -> None:
        self._stands.pop((path, inode, stand.end), None)
        self._stands[path, inode, stand.end] = stand
        if len(self._stands) > _MOST_STANDS:
            del self._stands[next(iter(self._stands))]


def _instance(path: Path) -> str | None:
    """The service that wrote a recording, None where the file beside it does not tell."""
    with suppress(LogError):
        return recorded_config(path).get("instance")
    return None


def _rest(log: Log) -> Log | None:
    """The rows after the last tick, None where there are none."""
    assert log.step is not None
    assert log.flags is not None
    ticks = np.flatnonzero(log.step)
    begin = int(ticks[-1]) + 1 if len(ticks) else 0
    if begin == len(log):
        return None
    late_s = None if log.late_s is None else log.late_s[begin:].copy()
    rows = log.time_s[begin:].copy(), log.channels, log.values[begin:].copy(), log.step[begin:].copy()
    return Log(log.path, *rows, log.flags[begin:], late_s)


def _note(notes: list[str], note: str) -> None:
    if note not in notes:
        notes.append(note)
