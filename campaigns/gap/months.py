"""Machines at work for weeks, in which something may appear: what the gap's watch says of them, from the
independent truth.

A working day is a programme of speeds and dwells of two or three hours, after which the machine stands for an
hour; then it is switched off, and the next day begins at another temperature.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from observer.align.aligner import frames_of_log
from observer.estimate.pipeline import MachineModel
from observer.frames import Inputs
from observer.quality.gap import GapState, GapWatch
from tests.learning.cover import log_of
from tests.learning.machines import CONFIG, Specimen, config_of, work
from tests.truth.machine.cycles import RUNS, Phase, START_m, programme
from tests.truth.machine.machine import stream

DAY_S = 86_400.0
REST = Phase(3600.0)
STEP_ROWS = 300
"""Rows of a log that are handed over at once: what is reported is looked at every five minutes."""


def _end(one: Specimen, days: float) -> Specimen:
    """A clamp has come loose: 0.5 W/K more to the air at the right end."""
    return _physics(one, end_W_K=one.machine.physics.end_W_K + np.array([0.0, 0.5]))


def _film(one: Specimen, days: float) -> Specimen:
    """A cover is gone: the film grows with speed, to twice itself and more."""
    return _physics(one, rotation_gain=0.5)


def _body(one: Specimen, days: float) -> Specimen:
    """A fixture has been bolted to the nut: 1500 J/K, 8 W/K from the screw."""
    return _physics(one, body_J_K=np.array([1500.0, 1.0, 1.0]), body_W_K=np.array([8.0, 0.0, 0.0]))


def _bearing(one: Specimen, days: float) -> Specimen:
    """The left bearing fails: twice its heat."""
    return _physics(one, friction_W_rpm=one.machine.physics.friction_W_rpm * np.array([1.0, 2.0, 1.0]))


def _drift(one: Specimen, days: float) -> Specimen:
    """The middle sensor drifts by 1 K a day, at night too."""
    third = np.array([0.0, 0.0, 1.0, 0.0, 0.0])
    offset_K = one.machine.offset_K + days * third
    return replace(one, machine=replace(one.machine, offset_K=offset_K, drift_K_h=third / 24.0))


def _physics(one: Specimen, **changes: object) -> Specimen:
    physics = one.machine.physics._replace(**changes)  # type: ignore[arg-type]
    return replace(one, machine=replace(one.machine, physics=physics))


EFFECTS: dict[str, tuple[Callable[[Specimen, float], Specimen], tuple[str, ...]]] = {
    "end loss 0.5 W/K": (_end, ("t5",)),
    "film that goes with speed": (_film, ("t1", "t2", "t3", "t4", "t5")),
    "body on the nut": (_body, ("t2", "t3", "t4")),
    "bearing with twice its heat": (_bearing, ("t1",)),
    "sensor drifts 1 K a day": (_drift, ("t3",)),
}
"""What may appear, and at which sensors it is to be seen."""


@dataclass(frozen=True)
class Found:
    """What the watch said over some days: the largest gap over what was allowed, and what it reported first:
    after how many hours of turning, of which sensor, in which phase; None where it reported nothing.
    """

    most: float
    after_h: float | None = None
    sensor: str | None = None
    phase: str | None = None


class Rig:
    """A configuration as its user has it, with what watches the gap."""

    def __init__(self, text: str = CONFIG) -> None:
        self._machine = MachineModel.of(config_of(text), learns=True)
        watch = self._machine.gap()
        assert watch is not None
        self.watch: GapWatch = watch

    def begin(self, state: GapState | None = None) -> None:
        """Begin anew, or go on from a state."""
        self.watch.restore(self.watch.initial() if state is None else state)

    def days(self, one: Specimen, seed: int, number: int, days: range, effect: str | None = None) -> Found:
        """Work for some days, over all of which an effect is there."""
        most, hours, first = 0.0, 0.0, None
        for i in days:
            now = one if effect is None else EFFECTS[effect][0](one, i - days.start)
            for inputs in self._inputs(now, seed, number, i):
                self.watch.take(inputs)
                hours += len(inputs) / 3600.0 * bool(inputs.law_W.any())
                most = max(most, self.watch.of_allowed)
                departure = self.watch.departure
                if departure is not None and first is None:
                    first = hours, departure.sensor, departure.phase
        return Found(most, *(first or (None, None, None)))

    def _inputs(self, one: Specimen, seed: int, number: int, i: int) -> list[Inputs]:
        rng = stream(seed, "month", str(number), str(i))
        run = RUNS[i % len(RUNS)]
        day = work(one, (*programme("standard", run, rng), REST), START_m[run], rng, 0.0)
        day = day._replace(time_s=day.time_s + i * DAY_S)
        state, blocks = self._machine.drive.initial(), []
        for frames in frames_of_log(log_of(day), self._machine.plan, STEP_ROWS):
            state, inputs = self._machine.drive.run(state, frames)
            blocks.append(inputs)
        return blocks
