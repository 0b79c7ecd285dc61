"""Notes: what somebody writes about a moment, kept beside the recordings, one JSON object a line.

A line is `{"time_s", "text", "by", "written_s"}`; an invalid line is left out.
"""

from __future__ import annotations

import json
import math
import os
import time
from pathlib import Path
from typing import Any

MOST_TEXT = 500
_MOST_BYTES = 4 << 20
_MOST_SHOWN = 500
_LATEST_S = 1e11


class Notes:
    """The notes of an axis, in a folder; None keeps none."""

    def __init__(self, folder: Path | None, name: str) -> None:
        self._path = None if folder is None else folder / f"{name}.notes.jsonl"

    def listed(self) -> list[dict[str, Any]]:
        """The newest notes, in the order of their moments; none where they cannot be read."""
        if self._path is None:
            return []
        try:
            with self._path.open("rb") as file:
                file.seek(max(0, self._path.stat().st_size - _MOST_BYTES))
                lines = file.read(_MOST_BYTES).splitlines()[-_MOST_SHOWN:]
        except OSError:
            return []
        found = [note for line in lines if (note := _note(line)) is not None]
        return sorted(found, key=lambda note: float(note["time_s"]))

    def add(self, time_s: str, text: str, by: str) -> None:
        """Write a note to disk; raises `ValueError` with one sentence if it is invalid or cannot be kept."""
        text = " ".join(text.split())
        try:
            about_s = float(time_s)
        except ValueError:
            about_s = math.nan
        if not abs(about_s) <= _LATEST_S:
            raise ValueError("a note needs a time; give time_s in seconds since 1970")
        if not text or len(text) > MOST_TEXT or not text.isprintable():
            raise ValueError(f"a note needs a text of 1 to {MOST_TEXT} characters")
        if self._path is None:
            raise ValueError("notes are kept beside the recordings; name a folder in record.directory")
        note = {"time_s": about_s, "text": text, "by": by, "written_s": round(time.time(), 3)}
        try:
            file = os.open(self._path, os.O_RDWR | os.O_APPEND | os.O_CREAT, 0o600)
            try:
                _append(file, json.dumps(note).encode() + b"\n")
            finally:
                os.close(file)
        except OSError as error:
            raise ValueError(f"{self._path}: the note cannot be written ({error.strerror})") from None


def _append(file: int, line: bytes) -> None:
    """Append a line where the file may end in half of one; raises `OSError`."""
    size = os.fstat(file).st_size
    if size and os.pread(file, 1, size - 1) != b"\n":
        line = b"\n" + line
    if os.write(file, line) != len(line):
        raise OSError(None, "the disk is full")
    os.fsync(file)


def _note(line: bytes) -> dict[str, Any] | None:
    try:
        note = json.loads(line)
        time_s = float(note["time_s"])
        kept = {"time_s": time_s, "text": str(note["text"]), "by": str(note["by"])}
    except (ValueError, KeyError, TypeError, RecursionError):
        return None
    return kept if math.isfinite(time_s) else None
