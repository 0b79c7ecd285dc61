"""An adopted configuration on trial: its open-loop gap compared with the previous one's, over the same hours.

Both predict the readings from the heat laws alone, by the same frames, beginning from the same readings.
After so many hours in which the machine ran, the adopted one is kept if its gap is smaller, else the previous
one is restored. This runs in a thread of its own, a minute of frames at a time: no tick waits for it.
"""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import structlog

from observer.errors import UserError
from observer.estimate.open_loop import OpenLoop, gap_K
from observer.estimate.pipeline import MachineModel
from observer.fit.runs import joined
from observer.frames import FrameBlock, Inputs
from observer.installation import Installation, load
from observer.installation.adopt import Adoption, adoption_of, before_of, note, sha256, take_back
from observer.live.observers import StepObserver

SHRUNK = 0.95
"""The adopted configuration is kept if its gap is at most this fraction of the other's over the same hours.
"""
LOOK_S = 2.0
BLOCK_S = 60.0
NOTE_S = 600.0
"""Interval of saving the progress: a restart loses no more."""
PAUSE_S = 30.0
"""After such a pause the screw's state is unknown: both predictions restart from the sensors."""
NOTICE_S = 600.0
_MOST_FRAMES = 100_000

log = structlog.get_logger()


class Pair:
    """Two open-loop predictions of the same readings, with the adoption's sums so far."""

    def __init__(self, before: Installation, now: Installation) -> None:
        self._machines = tuple(MachineModel.of(config) for config in (before, now))
        self._has_laws = any(source.law is not None for source in before.source)
        self._begin()

    def _begin(self) -> None:
        self._loops = [OpenLoop(machine.plant, machine.drive) for machine in self._machines]

    def see(self, adoption: Adoption, frames: FrameBlock) -> Adoption:
        """Add frames to the sums."""
        if float(frames.dt_s.max(initial=0.0)) > PAUSE_S:
            self._begin()
            return adoption
        found = [loop.run(frames) for loop in self._loops]
        if found[0] is None or found[1] is None:
            return adoption
        gaps_K = [gap_K(m.plant, *f) for m, f in zip(self._machines, found, strict=True) if f is not None]
        n = min(map(len, gaps_K))
        both = np.isfinite(gaps_K[0][-n:]) & np.isfinite(gaps_K[1][-n:])
        before, now = (float(np.sum(gap[-n:][both] ** 2)) for gap in gaps_K)
        return adoption.model_copy(
            update={
                "watched_h": adoption.watched_h + self._running_s(found[0][0]) / 3600.0,
                "values": adoption.values + int(both.sum()),
                "before_squares_K2": adoption.before_squares_K2 + before,
                "squares_K2": adoption.squares_K2 + now,
            }
        )

    def _running_s(self, inputs: Inputs) -> float:
        """How long some heat entered by its law; a machine at rest says nothing about either."""
        runs = (inputs.law_W != 0.0).any(axis=1) | (not self._has_laws)
        return float(inputs.dt_s[runs].sum())


def has_shrunk(adoption: Adoption) -> bool:
    """Whether the gap of the adopted configuration is smaller by more than a little."""
    return adoption.values > 0 and adoption.squares_K2 <= SHRUNK**2 * adoption.before_squares_K2


class AdoptionTrial(StepObserver):
    """Watches a configuration's file for adoptions, and judges them.

    `reload` has the service read its configuration again.
    """

    def __init__(self, config: Path, reload: Callable[[], None]) -> None:
        self._path = config.resolve()
        self._reload = reload
        self._hash = ""
        self._forget()
        self._problem: str | None = None
        self._reported: tuple[float, str] | None = None
        self._noted_s = time.monotonic()
        self._closing = threading.Event()
        self._adoption = self._read()
        self._seen = self._key(self._adoption)
        self._thread = threading.Thread(target=self._supervised, name="adoption", daemon=True)

    def start(self, in_force: Installation) -> None:
        """Begin to watch, a service with this configuration."""
        self.in_force(in_force)
        self._thread.start()

    def in_force(self, config: Installation) -> None:
        """Note that another configuration is in force from now on."""
        self._hash = config.digest
        self._forget()

    def _forget(self) -> None:
        self._frames: deque[FrameBlock] = deque(maxlen=_MOST_FRAMES)
        self._pair: Pair | None = None

    def see(self, frame: FrameBlock) -> None:
        """Take the frame of a tick."""
        if self._watching():
            self._frames.append(frame)

    def document(self) -> dict[str, Any] | None:
        """The last adoption as a field of health, None where there was none."""
        return None if self._adoption is None else self._adoption.document()

    def health(self) -> dict[str, Any]:
        """The last adoption."""
        return {"adoption": self.document()}

    def notices(self) -> tuple[str, ...]:
        """Reasons for health."""
        reasons = () if self._problem is None else (f"adoption: {self._problem}",)
        if self._reported is None or time.monotonic() - self._reported[0] > NOTICE_S:
            return reasons
        return (*reasons, f"adoption: {self._reported[1]}")

    def close(self, timeout_s: float) -> None:
        """Save the progress, and end."""
        self._closing.set()
        self._thread.join(timeout_s)

    def _supervised(self) -> None:
        """Watch until closed; whatever goes wrong is reported, and the service continues."""
        while not self._closing.wait(LOOK_S):
            try:
                self.look()
            except UserError as error:
                self._fail(str(error))
            except Exception as error:  # a defect in here must not end a service
                log.error("watching the adopted configuration failed", exc_info=True)
                self._fail(repr(error))
        if self._watching() and self._adoption is not None and self._adoption.values:
            self._note(self._adoption)

    def _fail(self, why: str) -> None:
        if why != self._problem:
            log.error("adoption", reason=why)
        self._problem = why

    def look(self) -> None:
        """Check whether something was adopted or reverted by hand, and process the frames so far."""
        try:
            adoption = adoption_of(self._path)
        except UserError as error:
            self._fail(str(error))
            return
        if self._key(adoption) != self._seen:
            self._adoption, self._seen, self._problem = adoption, self._key(adoption), None
            self._forget()
            log.info("a configuration was adopted or reverted", says=adoption and adoption.sentence())
            self._reload()
            return
        if (adoption := self._adoption) is None:
            self._problem = None
        elif adoption.state != "watching":
            self._note(adoption)
        elif sha256(self._path) != adoption.sha256:
            self._end(adoption.model_copy(update={"state": "replaced"}))
        elif self._watching():
            self._work(adoption)

    def _work(self, adoption: Adoption) -> None:
        frames = self._due(adoption)
        if not frames:
            return
        if self._pair is None:
            self._pair = Pair(load(before_of(self._path, adoption)), load(self._path))
        adoption = self._pair.see(adoption, joined(frames))
        self._adoption, self._problem = adoption, None
        if adoption.watched_h >= adoption.hours:
            self._decide(adoption)
        elif time.monotonic() - self._noted_s >= NOTE_S:
            self._note(adoption)

    def _due(self, adoption: Adoption) -> Sequence[FrameBlock]:
        """The frames so far, once they cover a minute, or a tenth of the time to watch."""
        frames = self._frames
        waiting = len(frames)
        if waiting < 2 or float(frames[-1].time_s[0] - frames[0].time_s[0]) < min(
            BLOCK_S, 360.0 * adoption.hours
        ):
            return ()
        return [frames.popleft() for _ in range(waiting)]

    def _decide(self, adoption: Adoption) -> None:
        if has_shrunk(adoption):
            self._end(adoption.model_copy(update={"state": "kept", "reason": "the gap has shrunk"}))
            return
        try:
            adoption = take_back(self._path, adoption, "taken_back", "the gap has not shrunk")
        except UserError as error:
            raise UserError(
                f"the gap has not shrunk, but the configuration cannot be reverted: {error}"
            ) from None
        self._adoption, self._seen = adoption, self._key(adoption)
        self._reported = (time.monotonic(), adoption.sentence())
        log.warning("adopted configuration reverted", says=adoption.sentence())
        self._reload()

    def _end(self, adoption: Adoption) -> None:
        self._adoption = adoption
        log.info("adopted configuration", says=adoption.sentence())
        self._note(adoption)

    def _note(self, adoption: Adoption) -> None:
        """Save the state if it has changed, unless somebody has undone or adopted meanwhile.

        A failed write is retried at the next check, if the watch has ended.
        """
        self._noted_s = time.monotonic()
        try:
            if adoption.state != "watching" and self._key(adoption) == self._seen:
                self._problem = None
            elif self._key(adoption_of(self._path)) == self._seen:
                note(self._path, adoption)
                self._seen, self._problem = self._key(adoption), None
        except UserError as error:
            self._fail(f"{error}; until then a restart forgets what has been watched")

    def _watching(self) -> bool:
        """Whether what is in force is on trial."""
        adoption = self._adoption
        return adoption is not None and adoption.state == "watching" and adoption.hash == self._hash

    def _read(self) -> Adoption | None:
        try:
            return adoption_of(self._path)
        except UserError as error:
            self._fail(str(error))
            return None

    @staticmethod
    def _key(adoption: Adoption | None) -> tuple[float, str] | None:
        return None if adoption is None else (adoption.adopted_s, adoption.state)
