"""What a worker does with a portion of orders: one after another, by parts that are built once.

No kernel steps several logs at a time; the logs of a portion share the machine, its estimator and the loaded
kernels, which cost more than a short log does.
"""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import lru_cache
from pathlib import Path
from typing import Any

from observer import app
from observer.errors import LogError, UserError
from observer.fleet.journal import (
    WHY,
    GivenUpError,
    How,
    Row,
    begin,
    clear_up,
    done,
    finish,
    made_of,
    put_away,
)
from observer.fleet.orders import Order, Verb
from observer.history.history import MethodOptions
from observer.installation import Installation, load

_TURN = threading.Lock()
"""One order at a time in a process, for pictures and its time are its own, however many its threads."""
_KEPT = 8
_EXIT = 70


def work(orders: Sequence[Order], how: How) -> list[Row]:
    """Do a portion of work; a row for each order, in which `problem` says what was wrong with it.

    A worker of a cluster outlives the command: what is left when that has ended is left.
    """
    with _TURN:
        rows = [_one(order, how) for order in orders if not how.has_ended]
        if how.has_ended:
            clear_up(how)
        return rows


def failed(order: Order, how: How, problem: str) -> Row:
    """The row of work that could not be done."""
    return {**_about(order, how), "problem": problem, "seconds": 0.0, "found": {}}


def _about(order: Order, how: How) -> Row:
    return {
        "machine": order.machine,
        "verb": how.verb,
        "name": order.name,
        "logs": [str(log) for log in order.logs],
        "config": str(order.config),
        "folder": str(order.place),
    }


def _one(order: Order, how: How) -> Row:
    if (row := done(order, how)) is not None:
        return row  # by a process that died later on in the same portion
    begun_s = time.monotonic()
    try:
        part = begin(order, how)
        with _for_at_most(order, how, part):
            stamp = _stamp(order, how)
            found = _VERBS[how.verb](order, how, part)
            row = {
                **_about(order, how), "problem": None, "seconds": time.monotonic() - begun_s, "found": found
            }  # fmt: skip
            finish(part, order, how, stamp, row)
            return row
    except UserError as error:
        problem = str(error)
    except OSError as error:
        problem = f"{error.filename or order.logs[0]}: {error.strerror}; see to that file"
    except Exception as error:  # noqa: BLE001 - whatever one log does, the others are to be finished
        problem = (
            f"{order.logs[0]}: a defect of the program, {type(error).__name__}: {error}; please report it"
        )
    put_away(order, how)
    return failed(order, how, problem)


def _stamp(order: Order, how: How) -> dict[str, Any]:
    for log in order.logs:
        if not log.is_file():
            raise LogError(f"{log}: no such file; give the path of a log")
    if not order.config.is_file():
        raise GivenUpError(f"{order.config}: no such file; give the path of a configuration")
    return made_of(order, how)


@contextmanager
def _for_at_most(order: Order, how: How, part: Path) -> Iterator[None]:
    """End this process where a piece of work takes too long: compiled code cannot be stopped otherwise."""

    def give_up() -> None:
        why = f"{order.logs[0]}: not done within {how.limit_s:g} s; try it alone, or with a longer --limit-s"
        (part / WHY).write_text(why, encoding="utf-8")
        os._exit(_EXIT)

    timer = threading.Timer(how.limit_s, give_up)
    timer.daemon = True
    timer.start()
    try:
        yield
    finally:
        timer.cancel()


def _replay(order: Order, how: How, part: Path) -> dict[str, Any]:
    config, ready = _ready(order.config, _text(order.config))
    summary = app.replay(
        order.logs[0], config, part, f".{how.format}", progress=_silent, ready=ready, picture=False
    )
    return _heats(config, summary) | {"good": summary["quality"]["good"] / max(1, summary["rows"])}


def _identify(order: Order, how: How, part: Path) -> dict[str, Any]:
    config, options = load(order.config), MethodOptions(how.method)
    summary = app.identify(
        order.logs[0], config, part, options, progress=_silent, suffix=f".{how.format}", picture=False
    )
    return _heats(config, summary)


def _calibrate(order: Order, _how: How, part: Path) -> dict[str, Any]:
    result = app.calibrate(order.logs, order.config, part, _silent)
    return _like(load(order.config)) | {
        key: result[key] for key in ("calibrated", "not_told", "gap", "doubts")
    }


def _discover(order: Order, _how: How, part: Path) -> dict[str, Any]:
    _, result = app.discover(order.config, order.logs, part, _silent, alone=True)
    kept = ("verdict", "effects", "alternatives", "family", "calibrated", "gap", "doubts")
    return _like(load(order.config)) | {key: result[key] for key in kept}


_VERBS: dict[Verb, Callable[[Order, How, Path], dict[str, Any]]] = {
    "replay": _replay,
    "identify": _identify,
    "calibrate": _calibrate,
    "discover": _discover,
}


def _heats(config: Installation, summary: dict[str, Any]) -> dict[str, Any]:
    kept = ("rows", "duration_s", "heat_mean_W", "speed_mean_rpm", "doubts")
    return _like(config) | {key: summary[key] for key in kept}


def _like(config: Installation) -> dict[str, Any]:
    """What machines that may be compared have in common: the screw's size, and the names of what heats it."""
    screw = config.screw
    return {
        "type": f"{screw.length_m:g} m × {1000 * screw.diameter_m:g} mm",
        "sources": [source.name for source in config.source],
    }


def _text(config: Path) -> bytes:
    return config.read_bytes()


@lru_cache(maxsize=_KEPT)
def _ready(config: Path, _text: bytes) -> tuple[Installation, app.Ready]:
    """What is built of a configuration, kept for the logs to come as long as its text is the same."""
    settings = load(config)
    return settings, app.Ready.of(settings)


def _silent(*_args: object) -> None:
    """Nobody watches a worker."""
