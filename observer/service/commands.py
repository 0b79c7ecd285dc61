"""Commands from authorised clients: obeyed between two steps, answered, logged and recorded."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterable, Sequence

import structlog

from observer.bus.exchange import Command, Outcome
from observer.service.observers import Answer, StepObserver

_FRESH_S = 5.0  # a client that asked longer ago has stopped waiting, and must not be surprised
_NOBODY = {
    "arm": "there is no compensation; set enabled = true in [compensation]",
    "disarm": "there is no compensation; set enabled = true in [compensation]",
    "zero": "there is no compensation; set enabled = true in [compensation]",
    "acknowledge": "there are no alarms; set enabled = true in [alarms]",
}

log = structlog.get_logger()


class Commands:
    """Makes the estimator and the observers of one service carry out its commands.

    It is used in the loop's thread. Every command gets one answer, one line in the log and one row in the
    recording.

    Args:
        period_s: The period of the ticks in s; a command older than two periods and 5 s is refused.
        reset: Restarts the estimator.
        observers: Asked in this order whether a command is for them.
        record: Records a command, as `record(time_s, kind, outcome)`.
    """

    def __init__(
        self,
        period_s: float,
        reset: Callable[[], None],
        observers: Sequence[StepObserver],
        record: Callable[[float, str, str], None],
    ) -> None:
        self._fresh_s = max(_FRESH_S, 2 * period_s)
        self._reset, self._observers, self._record = reset, observers, record
        self._obeyed: list[tuple[Command, Answer]] = []

    def before_step(self, commands: Iterable[Command], tick_s: float) -> None:
        """Obey the commands that came since the last step.

        A reset is done and answered at once. Others take effect in the step and are answered by `after_step`.

        Args:
            commands: The commands, oldest first. One that has `refused` is only logged and recorded.
            tick_s: The time of the next step, in s of the service's clock.
        """
        time_s = math.nextafter(tick_s, -math.inf)  # the row of a reset stands before the tick's
        for command in commands:
            if command.refused is not None:
                self._close(command, Outcome(False, command.refused, time_s))
            elif time.monotonic() - command.asked_s > self._fresh_s:
                self._close(command, Outcome(False, "not done: it waited too long; ask again", time_s))
            elif command.kind == "reset":
                self._reset()
                self._answers_to(command)
                self._close(command, Outcome(True, "the estimator restarts", time_s))
            else:
                self._obeyed += [(command, answer) for answer in self._answers_to(command)]

    def _answers_to(self, command: Command) -> list[Answer]:
        """Ask every observer; returns the answers, or the reason why none applies."""
        answers = [answer for observer in self._observers if (answer := observer.obey(command))]
        return answers or [lambda: (False, _NOBODY.get(command.kind, ""))]

    def after_step(self, tick_s: float) -> None:
        """Answer the commands whose outcome is known after the step; the others wait for the next one.

        Args:
            tick_s: The time of the step, in s of the service's clock.
        """
        obeyed, self._obeyed = self._obeyed, []
        for command, answer in obeyed:
            if (outcome := answer()) is None:
                self._obeyed.append((command, answer))
            else:
                self._close(command, Outcome(*outcome, tick_s))

    def _close(self, command: Command, outcome: Outcome) -> None:
        if command.refused is None:  # else the sender has been answered already
            command.answer(outcome)
        log.info("command", command=command.kind, done=outcome.done, text=outcome.text, by=command.by)
        entry = f"done by {command.by}" if outcome.done else f"refused to {command.by}: {outcome.text}"
        self._record(outcome.time_s, command.kind, entry)
