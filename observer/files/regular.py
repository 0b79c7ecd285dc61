"""Reading a file that a user names, which may be anything."""

from __future__ import annotations

import os
import stat
from pathlib import Path

from observer.errors import UserError


def one_line(reason: str) -> str:
    """Return the first line of what a library says of a file, without what cannot be printed."""
    first = reason.strip().split("\n", 1)[0][:200]
    return "".join(c if c.isprintable() else "?" for c in first)


def refuse_irregular(path: Path, what: str, opened: int | None = None) -> None:
    """Raise `OSError` where there is nothing, `UserError` where there is a pipe, a device or a folder.

    `opened` is the descriptor of the file where that is open already.
    """
    mode = os.stat(path if opened is None else opened).st_mode
    if not stat.S_ISREG(mode):
        kind = "a folder" if stat.S_ISDIR(mode) else "no ordinary file"
        raise UserError(f"{path}: cannot be read, it is {kind}; give {what}")


def read_regular(path: Path, most_bytes: int, what: str) -> bytes:
    """Read a file that is a file: a pipe would be waited for, a device may never end.

    Raises `OSError`, or `UserError` for what is no file of at most `most_bytes`.
    """
    descriptor = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
    with open(descriptor, "rb") as file:
        refuse_irregular(path, what, descriptor)
        data = file.read(most_bytes + 1)
    if len(data) > most_bytes:
        raise UserError(f"{path}: is larger than {most_bytes / 1e6:g} MB; give {what}")
    return data
