"""Commands of those who may act: obeyed between two steps, answered, logged and put on record."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterable

import structlog

from observer.control.compensation import Compensator
from observer.exchange import Command, Outcome
from observer.frames import Reading
from observer.record.recorder import Recorder

_FRESH_S = 5.0  # who asked longer ago has stopped waiting, and must not be surprised

log = structlog.get_logger()


class Commands:
    """Carries out what was asked of one service.

    `row` makes a row of the recording out of a moment: the reading without values that the aligner puts among
    the others; `reset` starts the estimator afresh; `acknowledge` notes that somebody has seen an alarm, or
    says why not.
    """

    def __init__(
        self,
        period_s: float,
        compensator: Compensator | None,
        recorder: Recorder | None,
        row: Callable[[Reading], Reading],
        reset: Callable[[], None],
        acknowledge: Callable[[str | None], str | None],
    ) -> None:
        self._fresh_s = max(_FRESH_S, 2 * period_s)
        self._compensator = compensator
        self._recorder = recorder
        self._row = row
        self._reset = reset
        self._acknowledge = acknowledge
        self._arming: list[Command] = []

    def before_step(self, commands: Iterable[Command], tick_s: float) -> None:
        """Obey the commands that came since the last step; `tick_s` is the time of the next one."""
        time_s = math.nextafter(tick_s, -math.inf)  # the row of a reset stands before the tick's
        for command in commands:
            if command.refused is not None:
                self._close(command, Outcome(False, command.refused, time_s))
            elif time.monotonic() - command.asked_s > self._fresh_s:
                self._close(command, Outcome(False, "not done: it waited for too long; ask again", time_s))
            elif command.kind == "reset":
                self._close(command, self._reset_all(time_s))
            elif command.kind == "acknowledge":
                why_not = self._acknowledge(command.about)
                text = why_not or f"acknowledged: {command.about or 'all'}"
                self._close(command, Outcome(why_not is None, text, time_s))
            elif self._compensator is None:
                text = "there is no compensation; set enabled = true in [compensation]"
                self._close(command, Outcome(False, text, time_s))
            elif command.kind == "disarm":
                self._close(command, self._disarm(self._compensator, command, time_s))
            else:
                self._compensator.arm()
                self._arming.append(command)

    def after_step(self, tick_s: float) -> None:
        """Answer those who asked to arm the compensation, by what came of it in the step."""
        arming, self._arming = self._arming, []
        for command in arming:
            assert self._compensator is not None
            reason = self._compensator.reason
            done = reason is None
            self._close(command, Outcome(done, "armed" if reason is None else f"not armed: {reason}", tick_s))

    def _reset_all(self, time_s: float) -> Outcome:
        self._reset()
        if self._compensator is not None:
            self._compensator.disarm("the estimator was started afresh; arm again")
        return Outcome(True, "the estimator starts afresh", time_s)

    def _disarm(self, compensator: Compensator, command: Command, time_s: float) -> Outcome:
        before = compensator.reason
        compensator.disarm(f"disarmed by {command.by}; arm again")
        return Outcome(True, "disarmed" if before is None else f"it was off already: {before}", time_s)

    def _close(self, command: Command, outcome: Outcome) -> None:
        if command.refused is None:  # else the sender has been answered already
            command.answer(outcome)
        log.info("command", command=command.kind, done=outcome.done, text=outcome.text, by=command.by)
        if self._recorder is not None:
            used = self._row(Reading(outcome.time_s, {}))
            what = f"done by {command.by}" if outcome.done else f"refused to {command.by}: {outcome.text}"
            self._recorder.command(used.time_s, command.kind, what)
