"""Reading a file that a user names, which may be anything."""

from __future__ import annotations

import os
import stat
from pathlib import Path

from observer.errors import UserError


def read_regular(path: Path, most_bytes: int, what: str) -> bytes:
    """Read a file that is a file: a pipe would be waited for, a device may never end.

    Raises `OSError`, or `UserError` for what is no file of at most `most_bytes`.
    """
    descriptor = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
    with open(descriptor, "rb") as file:
        mode = os.fstat(descriptor).st_mode
        if not stat.S_ISREG(mode):
            kind = "a folder" if stat.S_ISDIR(mode) else "no ordinary file"
            raise UserError(f"{path}: cannot be read, it is {kind}; give {what}")
        data = file.read(most_bytes + 1)
    if len(data) > most_bytes:
        raise UserError(f"{path}: is larger than {most_bytes / 1e6:g} MB; give {what}")
    return data
