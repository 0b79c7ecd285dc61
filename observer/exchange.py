"""What service and publisher hand to each other: commands, what came of them, and how publishing stands."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass

KINDS = ("arm", "disarm", "reset", "acknowledge")
_STRANGE = re.compile(r"[^A-Za-z0-9_.@-]")
_NAME_LENGTH = 64


@dataclass(frozen=True, slots=True)
class Outcome:
    """Whether a command was done, why or why not in words, and when (service time)."""

    done: bool
    text: str
    time_s: float


@dataclass(frozen=True, slots=True)
class Command:
    """One of `KINDS`, asked by somebody who says to be `by`.

    `refused` is the reason where it was refused already and is only to be put on record. `asked_s` is the
    moment on the monotonic clock. `answer` takes the outcome from any thread and waits for nothing. `about`
    is the alarm that is acknowledged, None for all.
    """

    kind: str
    by: str
    asked_s: float
    answer: Callable[[Outcome], None]
    refused: str | None = None
    about: str | None = None


def plain_name(text: str, most: int = _NAME_LENGTH) -> str:
    """A name as it may stand in a log: short, and of letters, digits and `_.@-` only."""
    return _STRANGE.sub("_", text[:most])


@dataclass(frozen=True, slots=True)
class PublishStatus:
    """How publishing stands; `reason` says in one sentence what is wrong, None if nothing is.

    `settled` says that the first attempt at a session has ended. `taken` is a sentence where another service
    has the axis, `rival` one where another program publishes on its keys. Without `alive` nobody is answered
    any more.
    """

    connected: bool = False
    published: int = 0
    dropped: int = 0
    reconnects: int = 0
    reason: str | None = None
    settled: bool = True
    taken: str | None = None
    rival: str | None = None
    alive: bool = True
