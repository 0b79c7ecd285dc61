"""What is done stands in its own folder, with what it was made of: there with the results or not at all.

There is no other list that could disagree with the files, be cut off, or be written by two at a time.
"""

from __future__ import annotations

import fcntl
import hashlib
import json
import secrets
import shutil
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any

from observer.errors import UserError
from observer.files.results import write_json
from observer.fleet.orders import Order, Verb
from observer.history.history import Method

DONE = "done.json"
WORK = ".work"
WHY = "why"
LIVES = "lives"
"""A file in the folder of a run: a worker whose folder was removed beneath it makes that again."""
TRIES = 2

Row = dict[str, Any]


@dataclass(frozen=True, slots=True)
class How:
    """What is done to every order: the verb, its options, where results go, and how long one may take."""

    verb: Verb
    output: Path
    format: str = "parquet"
    method: Method = "smoother"
    limit_s: float = 3600.0
    run: str = ""
    """Names the folder beneath `.work` of one run of the command, which goes when that ends."""

    @property
    def work(self) -> Path:
        """The folder that is worked in."""
        return self.output / WORK / self.run

    @property
    def has_ended(self) -> bool:
        """Whether the run that gave the order is over: nobody waits for what is left of it."""
        return bool(self.run) and not (self.work / LIVES).exists()

    @property
    def options(self) -> dict[str, str]:
        """What the results depend on beside logs and configuration."""
        chosen = {"verb": self.verb, "version": version("ballscrew-observer")}
        if self.verb in ("replay", "identify"):
            chosen["format"] = self.format
        if self.verb == "identify":
            chosen["method"] = self.method
        return chosen


class GivenUpError(UserError):
    """Work that will not be tried again."""


def made_of(order: Order, how: How) -> dict[str, Any]:
    """Return what results depend on: options, the text of the configuration, size, time and text of each log.

    Raises `OSError` where a file is not there.
    """
    return {
        **how.options,
        "config_sha256": _digest(order.config),
        "logs": [{"path": str(log), **_look(log), "sha256": _digest(log)} for log in order.logs],
    }


def done(order: Order, how: How) -> Row | None:
    """Return the row of work that is done, unless logs, configuration or options have changed since."""
    try:
        document = json.loads((how.output / order.place / DONE).read_text(encoding="utf-8"))
        stamp, row = document["made_of"], document["row"]
        if stamp["config_sha256"] != _digest(order.config):
            return None
        if {key: stamp.get(key) for key in how.options} != how.options:
            return None
        logs = {entry["path"]: entry for entry in stamp["logs"]}
        if list(logs) != [str(log) for log in order.logs]:
            return None
        same = all(_is_same(log, logs[str(log)]) for log in order.logs)
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        return None
    return dict(row) if same else None


def _look(log: Path) -> dict[str, int]:
    about = log.stat()
    return {"bytes": about.st_size, "mtime_ns": about.st_mtime_ns}


def _is_same(log: Path, entry: Mapping[str, Any]) -> bool:
    """Whether a log is as it was: by size and time, or, copied anew, by its text."""
    now = _look(log)
    if now["bytes"] != entry["bytes"]:
        return False
    return bool(now["mtime_ns"] == entry["mtime_ns"] or _digest(log) == entry["sha256"])


def _digest(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def begin(order: Order, how: How) -> Path:
    """Make the folder that an order is worked on in. What stands there tells of earlier tries that died.

    Raises `GivenUpError` where the time was up, or two tries have ended with their process.
    """
    base = hashlib.sha256(str(order.place).encode()).hexdigest()[:24]
    tries = [how.work / f"{base}.{number}" for number in range(1, TRIES + 1)]
    for part in tries:
        if not part.exists():
            part.mkdir(parents=True)
            return part
        with suppress(OSError):
            raise GivenUpError((part / WHY).read_text(encoding="utf-8"))
    raise GivenUpError(
        f"{order.logs[0]}: the process that worked on it has died {TRIES} times, perhaps for want of memory; "
        "try it alone, with a larger --memory-GB, or shorten it"
    )


def finish(part: Path, order: Order, how: How, stamp: Mapping[str, Any], row: Row) -> None:
    """Put the results in their place, with what they were made of; older ones go."""
    write_json(part / DONE, {"made_of": stamp, "row": row})
    place = how.output / order.place
    place.parent.mkdir(parents=True, exist_ok=True)
    old = part.with_name(f"{part.name}.old")
    if place.exists():
        place.rename(old)
    part.rename(place)
    shutil.rmtree(old, ignore_errors=True)
    put_away(order, how)


def put_away(order: Order, how: How) -> None:
    """Remove what tries that died have left of an order."""
    base = hashlib.sha256(str(order.place).encode()).hexdigest()[:24]
    for part in how.work.glob(f"{base}.*"):
        shutil.rmtree(part, ignore_errors=True)


def clear_up(how: How) -> None:
    """Remove what was made in the folder of a run after its end."""
    shutil.rmtree(how.work, ignore_errors=True)
    with suppress(OSError):  # another run is at work
        (how.output / WORK).rmdir()


@contextmanager
def alone_in(output: Path) -> Iterator[Path]:
    """Have a folder of results for this run alone; yields where work is done, empty, to go at the end.

    Raises `UserError` where another run is at work there, or nothing can be written.
    """
    work = output / WORK
    try:
        output.mkdir(parents=True, exist_ok=True)
        with (output / ".lock").open("w") as lock:
            try:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
                if not (output / ".lock").exists():  # removed by a run that ended at this moment
                    raise BlockingIOError
            except BlockingIOError:
                raise UserError(
                    f"{output}: another run is at work there; wait for it, or name another folder"
                ) from None
            try:
                shutil.rmtree(work, ignore_errors=True)  # left by a run that was killed
                folder = work / secrets.token_hex(4)
                folder.mkdir(parents=True)
                (folder / LIVES).touch()
                yield folder
            finally:
                shutil.rmtree(work, ignore_errors=True)
                (output / ".lock").unlink(missing_ok=True)
    except OSError as error:
        raise UserError(
            f"{output}: results cannot be written there ({error.strerror}); name a folder that can be "
            "written, or free space"
        ) from None


def rows_in(output: Path) -> Iterator[Row]:
    """Yield the rows of all work that is done in a folder of results, of whichever verb."""
    for file in sorted(output.glob(f"*/*/{DONE}")) + sorted(output.glob(f"*/*/*/{DONE}")):
        with suppress(OSError, ValueError, KeyError, TypeError):
            yield dict(json.loads(file.read_text(encoding="utf-8"))["row"])
