"""Published steps, read by time from the folder of a service's recordings."""

from __future__ import annotations

import math
import os
from pathlib import Path
from typing import Any

import numpy as np

from observer.errors import ConfigError
from observer.library.packages import in_words
from observer.record.step_files import axes_of
from observer.record.step_store import Past


class PublishedSteps:
    """The published steps of one axis by time, read from files that the service writes meanwhile.

    Attributes:
        name: `<machine>-<axis>`.
    """

    def __init__(self, steps: Past) -> None:
        self._steps = steps
        self.name = steps.name

    @property
    def span_s(self) -> tuple[float, float] | tuple[None, None]:
        """The times of the first and the last step in s since 1970; two None without any step.

        It is read from the files at each call, so it grows while the service runs.
        """
        return self._steps.span_s()

    @in_words
    def table(
        self,
        from_s: float = -math.inf,
        to_s: float = math.inf,
        signals: tuple[str, ...] = (),
        every_s: float = 0.0,
    ) -> Any:
        """Return the steps from one time up to another as a `pyarrow.Table`, at most one in each
        `every_s`.

        Args:
            from_s: First time, s since 1970.
            to_s: End, itself excluded.
            signals: Columns of `estimates.csv`, and channels; empty for the values of all channels.
            every_s: Keep the first step of each such interval; 0 keeps all.

        Returns:
            `time_s` and a column (K,) for each signal, NaN where a file lacks it. A quality is a code, the
                better before the worse.

        Raises:
            LogError: A file is damaged, or the folder cannot be read.
            UserError: pyarrow is not installed.
        """
        import pyarrow as pa

        columns = self._steps.columns(signals or self._steps.channels(), from_s, to_s)
        chosen: Any = slice(None)
        if every_s:
            slots = np.floor(columns["time_s"] / every_s)
            chosen = np.flatnonzero(np.diff(slots, prepend=math.nan) != 0)
        return pa.table({name: column[chosen] for name, column in columns.items()})

    def __repr__(self) -> str:
        return f"<PublishedSteps: {self.name}>"


def past(folder: str | os.PathLike[str], name: str | None = None) -> PublishedSteps:
    """Return the published steps in a folder of recordings.

    Args:
        folder: The service's `record.directory`, or a copy of it.
        name: `<machine>-<axis>`; None if the folder has one axis only.

    Raises:
        ConfigError: The folder has no steps of `name`, or several axes and no `name` is given.
        LogError: The folder cannot be read.
    """
    axes = axes_of(Path(folder))
    if name is None and len(axes) == 1:
        (name,) = axes
    if name not in axes:
        choice = f"name one of {', '.join(axes)}" if axes else "run a service that records there"
        several = "published steps of several axes" if axes else "no published steps"
        steps = several if name is None else f"no published steps of {name}"
        raise ConfigError(f"{folder}: holds {steps}; {choice}")
    return PublishedSteps(Past(Path(folder), name))
