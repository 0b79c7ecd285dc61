"""What service, publisher and outlets share: the published keys, commands and their outcomes, the status."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

ESTIMATE_ENCODING = "application/cbor;ballscrew.estimate.v1"
ESTIMATES_ENCODING = "application/cbor;ballscrew.estimates.v1"
JSON_ENCODING = "application/json"


@dataclass(frozen=True, slots=True)
class Key:
    """A key below `ballscrew/<machine>/<axis>/` that is published `when`, None where it only answers.

    It exists if the service has what it `needs`. One that `answers` is a queryable too, for every role that
    may query (`publish.session`). An MQTT broker, and a gateway that starts late, get the last message of a
    `retained` key at once. The page shows one at most every `page_every_s`.
    """

    when: str | None
    encoding: str = JSON_ENCODING
    answers: bool = False
    retained: bool = False
    needs: Literal["learned", "compensation", "forecast"] | None = None
    page_every_s: float = 0.0


KEYS = {
    "estimate": Key("every step", ESTIMATE_ENCODING, answers=True, page_every_s=0.09),
    "readings": Key("every step", page_every_s=0.09),
    "heat": Key("every step", page_every_s=0.09),
    "field": Key("at most `field_rate_Hz`", page_every_s=0.45),
    "error": Key("at most `field_rate_Hz`", page_every_s=0.45),
    "learned": Key("once a second, if anything is", retained=True, needs="learned"),
    "health": Key("on change, and every 5 s", answers=True, retained=True),
    "alarms": Key("on change, and every 5 s", answers=True, retained=True),
    "forecast": Key("every minute, unless off", answers=True, retained=True, needs="forecast"),
    "compensation": Key("every step, if enabled", answers=True, retained=True, needs="compensation"),
    "config": Key(None, answers=True, retained=True),
}
"""All that publisher, gateway, MQTT and page need to know of a key, besides what makes its payload."""
RETAINED = tuple(name for name, key in KEYS.items() if key.retained)

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
