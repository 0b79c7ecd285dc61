"""The published steps of an axis by time; usable from any thread."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from observer.errors import LogError
from observer.record.step_columns import StepRows
from observer.record.step_files import StepFile, read_columns, read_steps, step_files


@dataclass(frozen=True, slots=True)
class Past:
    """The published steps of an axis in a folder of recordings.

    Each call lists the folder, so steps written meanwhile are found.

    Attributes:
        folder: The service's `record.directory`.
        name: `<machine>-<axis>`.
    """

    folder: Path
    name: str

    def files(self) -> list[StepFile]:
        """Return the files in the order of time; empty for a missing folder.

        Raises:
            LogError: The folder cannot be read.
        """
        return step_files(self.folder, self.name)

    def read(
        self,
        from_s: float,
        to_s: float,
        notes: list[str],
        *,
        backwards: bool = False,
    ) -> Iterator[StepRows]:
        """Yield the steps from one time up to another, a piece of one file at a time.

        A time that was already passed, because the clock was set back, is left out.

        Args:
            from_s: First time, s since 1970.
            to_s: End, itself excluded.
            notes: Gets a sentence on each file that is damaged and left out, or is not as it was published.
            backwards: The later pieces come first, each still in the order of time.

        Raises:
            LogError: The folder cannot be read.
        """
        files, passed_s = self.files(), math.inf if backwards else -math.inf
        for file in reversed(files) if backwards else files:
            if file.to_s <= from_s or file.from_s >= to_s:
                continue
            try:
                for steps in read_steps(file, from_s, to_s, backwards=backwards):
                    new = steps.time_s < passed_s if backwards else steps.time_s > passed_s
                    if new.any():
                        piece = steps if new.all() else steps.at(new)
                        passed_s = float(piece.time_s[0 if backwards else -1])
                        _note(notes, steps.source.note)
                        yield piece
            except LogError as error:
                _note(notes, f"{error}; it is left out")

    def channels(self) -> tuple[str, ...]:
        """Return the channels of the newest file that can be read; empty without one."""
        for file in self.files()[::-1]:
            with suppress(LogError, FileNotFoundError):
                return read_columns(file, math.inf, math.inf, ())[0]
        return ()

    def span_s(self) -> tuple[float, float] | tuple[None, None]:
        """Return the times of the first and the last step, two None without any; damaged files are left
        out.
        """
        files = self.files()
        first = next(self._times_s(files), None)
        last = next(self._times_s(files[::-1]), None)
        return (None, None) if first is None or last is None else (float(first[0]), float(last[-1]))

    def newest_s(self, from_s: float, to_s: float) -> float:
        """Return the time of the last step of a span, -inf without any; damaged files are left out."""
        files = [file for file in self.files() if file.to_s > from_s and file.from_s < to_s]
        return max((float(time_s[-1]) for time_s in self._times_s(files, from_s, to_s)), default=-math.inf)

    def columns(self, names: Sequence[str], from_s: float, to_s: float) -> dict[str, NDArray[Any]]:
        """Return `time_s` and the named columns (K,) of a span; NaN where a file has no such column.

        Where the clock was set back, the steps of a time that was already passed are left out.

        Args:
            names: Columns as of `StepSource.places`.
            from_s: First time, s since 1970.
            to_s: End, itself excluded.

        Raises:
            LogError: A file is damaged, or the folder cannot be read.
        """
        blocks, passed_s = list[list[NDArray[Any]]](), -math.inf
        for file in self.files():
            if file.to_s <= from_s or file.from_s >= to_s:
                continue
            with suppress(FileNotFoundError):  # packed or removed meanwhile
                _, columns = read_columns(file, from_s, to_s, names)
                begin = int(np.searchsorted(columns[0], passed_s, side="right"))
                blocks.append([column[begin:] for column in columns])
                passed_s = max([passed_s, *columns[0][-1:]])
        pieces = zip(*blocks, strict=True) if blocks else ([np.empty(0)] for _ in ("time_s", *names))
        return {n: np.concatenate(piece) for n, piece in zip(("time_s", *names), pieces, strict=True)}

    @staticmethod
    def _times_s(
        files: Sequence[StepFile], from_s: float = -math.inf, to_s: float = math.inf
    ) -> Iterator[NDArray[Any]]:
        """Yield the times of the steps of each file that has some; a damaged one is left out."""
        for file in files:
            with suppress(LogError, FileNotFoundError):
                _, (time_s,) = read_columns(file, from_s, to_s, ())
                if len(time_s):
                    yield time_s


def _note(notes: list[str], note: str) -> None:
    if note and note not in notes:
        notes.append(note)
