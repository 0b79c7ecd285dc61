"""Published steps, read by time from the folder of a service's recordings."""

from __future__ import annotations

import math
import os
from pathlib import Path
from typing import Any

import numpy as np

from observer.errors import ConfigError
from observer.library.packages import in_words
from observer.steps.files import axes_of
from observer.steps.store import Past


class PublishedSteps:
    """The published steps of one axis by time; `name` is `<machine>-<axis>`."""

    def __init__(self, steps: Past) -> None:
        self._steps = steps
        self.name = steps.name

    @property
    def span_s(self) -> tuple[float, float] | tuple[None, None]:
        """The times of the first and the last step in s since 1970, None without any."""
        return self._steps.span_s()

    @in_words
    def table(
        self,
        from_s: float = -math.inf,
        to_s: float = math.inf,
        signals: tuple[str, ...] = (),
        every_s: float = 0.0,
    ) -> Any:
        """Return the steps from one time up to another as a `pyarrow.Table`, at most one in each `every_s`.

        The columns are `time_s` and the `signals`: those of `estimates.csv`, and channels. Without `signals`
        they are the values of all channels. Quality is a code, the better before the worse.
        Raises `LogError` for a damaged file, `UserError` without pyarrow.
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
    """Return the published steps in a folder of recordings, those of the axis `name` if there are several.

    Raises `ConfigError` where `name` is not there, or is needed; `LogError` where the folder cannot be read.
    """
    axes = axes_of(Path(folder))
    if name is None and len(axes) == 1:
        (name,) = axes
    if name not in axes:
        choice = f"name one of {', '.join(axes)}" if axes else "run a service that records there"
        raise ConfigError(
            f"{folder}: has no published steps{f' of {name}' if name else ' of one axis only'}; {choice}"
        )
    return PublishedSteps(Past(Path(folder), name))
