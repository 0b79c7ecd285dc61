"""Ticks of an estimator at 10 Hz with the forecaster beside them: how late each was done, in one run.

Forecasts are far more frequent here than in a service, so that ticks with and without one alternate and see
the same computer. `python -m campaigns.forecast.beside` prints the figures.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any, NamedTuple
from unittest.mock import patch

import numpy as np

from observer.align.aligner import frames_of_log
from observer.estimate.checkpoint import Snapshot
from observer.estimate.pipeline import MachineModel
from observer.forecast.document import forecast
from observer.frames import EstimateBlock, FloatArray, FrameBlock
from observer.service import forecasting
from observer.service.forecasting import Forecaster
from observer.service.observers import Step
from observer.service.wires import take_short_turns
from tests.learning.cover import log_of
from tests.learning.machines import CONFIG, Rough, config_of, day, draw

PERIOD_S = 0.1
LEARNT_ROWS = 1800
SETTLE_TICKS = 20
MISSED_S = PERIOD_S


class Forecasts(NamedTuple):
    """Of each forecast when it began and ended, what it took of a core, in s, and in which thread."""

    begin_s: list[float]
    end_s: list[float]
    cpu_s: list[float]
    thread: list[int]


class Ticks(NamedTuple):
    """How late ticks were done, in s: those with a forecast beside them, and those without."""

    beside_s: FloatArray
    alone_s: FloatArray
    forecasts: Forecasts

    @property
    def ratio(self) -> float:
        """The median with a forecast over that without."""
        return float(np.median(self.beside_s) / np.median(self.alone_s))


@contextmanager
def _watched() -> Iterator[Forecasts]:
    """Note each forecast that is computed meanwhile."""
    seen = Forecasts([], [], [], [])

    def noted(*arguments: Any) -> Any:
        seen.thread.append(threading.get_ident())
        seen.begin_s.append(time.monotonic())
        cpu_s = time.thread_time()
        try:
            return forecast(*arguments)
        finally:
            seen.cpu_s.append(time.thread_time() - cpu_s)
            seen.end_s.append(time.monotonic())

    with patch.object(forecasting, "forecast", noted):
        yield seen


def ticks(seconds: float) -> Ticks:
    """Tick for some seconds, threads taking turns as in the service."""
    take_short_turns()
    config = config_of(CONFIG, "\n[forecast]\nperiod_s = 5.0\n")
    machine = MachineModel.of(config, learns=True)

    def publish(_document: Mapping[str, Any]) -> None:
        """Nobody listens."""

    forecaster, pipeline = Forecaster(machine, "", publish), machine.pipeline(machine.estimator())
    log = log_of(day(draw(1, 3, Rough()), 1, 3, "a"))
    first = next(iter(frames_of_log(log, machine.plan, LEARNT_ROWS)))
    block = pipeline.step(first)

    def follow(frame: FrameBlock, block: EstimateBlock) -> None:
        def snapshot() -> Snapshot:
            return Snapshot(float(block.time_s[-1]), *pipeline.snapshot())

        forecaster.follow(Step(frame, pipeline.inputs, block, now_s=time.monotonic(), snapshot=snapshot))

    follow(first, block)
    frames = frames_of_log(log, machine.plan, 1)
    for _ in range(LEARNT_ROWS):
        next(frames)
    never, due_s, done_s, late_s = threading.Event(), time.monotonic(), [], []
    with _watched() as seen:
        forecaster.begin()
        for _ in range(round(seconds / PERIOD_S)):
            due_s = max(due_s + PERIOD_S, time.monotonic() - PERIOD_S)
            never.wait(max(due_s - time.monotonic(), 0.0))
            frame = next(frames)
            follow(frame, pipeline.step(frame))
            done_s.append(time.monotonic())
            late_s.append(done_s[-1] - due_s)
        forecaster.finish(None)
    at, late = np.array(done_s)[SETTLE_TICKS:], np.array(late_s)[SETTLE_TICKS:]
    ends = [*seen.end_s, *[np.inf] * (len(seen.begin_s) - len(seen.end_s))]
    beside = np.any([(at >= b) & (at - late <= e) for b, e in zip(seen.begin_s, ends, strict=True)], axis=0)
    return Ticks(late[beside], late[~beside], seen)


def main() -> None:
    """Print what three minutes of ticks show."""
    found = ticks(180.0)
    for name, late_s in (("with", found.beside_s), ("without", found.alone_s)):
        half, most = 1e3 * np.percentile(late_s, (50, 95))
        missed = int((late_s >= MISSED_S).sum())
        print(
            f"{len(late_s)} ticks {name} a forecast: done {half:.1f} ms late in the median, 95 % within "
            f"{most:.1f} ms, {missed} missed"
        )
    cpu_s = np.median(found.forecasts.cpu_s)
    print(f"ratio of the medians {found.ratio:.2f}; a forecast takes {cpu_s:.2f} s of a core")


if __name__ == "__main__":
    main()
