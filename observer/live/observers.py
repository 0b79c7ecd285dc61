"""What follows the loop beside the estimates, one step after the other."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from observer.estimate.checkpoint import Snapshot
from observer.frames import EstimateBlock, FrameBlock, Inputs
from observer.quality.alarms import AlarmDesk
from observer.quality.conditions import Facts
from observer.quality.health import HEALTH_PERIOD_S

_END_S = 0.1


@dataclass(frozen=True, slots=True)
class Step:
    """What the loop took in and gave out at a tick at `now_s` of its clock; blocks of one.

    `snapshot` gives the state of the pipeline after it, None while the estimator knows nothing yet.
    """

    frame: FrameBlock
    inputs: Inputs
    estimate: EstimateBlock
    now_s: float = math.nan
    snapshot: Callable[[], Snapshot | None] = lambda: None


class StepObserver:
    """Follows the loop; hooks that a subclass leaves out do nothing. Only `finished` may wait, for 0.1 s."""

    alive = True
    """Whether its thread lives; if not, the watchdog is not pinged."""

    def begin(self) -> None:
        """Start, before the first tick."""

    def see(self, frame: FrameBlock) -> None:
        """Take the frame of a tick, whether or not the estimator's step succeeds."""

    def follow(self, step: Step) -> None:
        """Take a step that succeeded, once its estimate is published."""

    def report(self, facts: Facts) -> None:
        """Take the facts of a health report."""

    def notices(self) -> tuple[str, ...]:
        """Reasons for health."""
        return ()

    def health(self) -> dict[str, Any]:
        """Fields of the health document."""
        return {}

    def finish(self, snapshot: Snapshot | None) -> None:
        """End; `snapshot` is where the pipeline stands."""

    def finished(self) -> str | None:
        """Wait for the end; returns what was not done in time."""
        return None


class AlarmObserver(StepObserver):
    """Publishes alarms on change and every five seconds; `air` is the column of the ambient in `z_end`."""

    def __init__(
        self,
        desk: AlarmDesk,
        publish: Callable[[Mapping[str, Any]], None],
        air: int,
        instance: str,
    ) -> None:
        self._desk, self._publish, self._air, self._instance = desk, publish, air, instance
        self._sent_s = -math.inf

    def follow(self, step: Step) -> None:
        """Take an estimate."""
        self._desk.see(step.estimate, step.frame, float(step.inputs.z_end[0, self._air]))

    def report(self, facts: Facts) -> None:
        """Judge and publish."""
        changed = self._desk.look(facts)
        if changed or facts.time_s - self._sent_s >= HEALTH_PERIOD_S:
            self._sent_s = facts.time_s
            self._publish(self._desk.document(facts.time_s) | {"instance": self._instance})

    def finished(self) -> str | None:
        """Wait until the alarms are on the disk."""
        return None if self._desk.close(_END_S) else "what is known of alarms could not be kept in time"
