"""Steps with channels of given values, as files of the past."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from observer.frames import Layout
from observer.record.step_columns import StepSource
from observer.record.step_files import StepAppender, pack_closed

LAYOUT = Layout(("nut",), np.linspace(0.0, 1.0, 21), ("t1",), has_error=True)


def write_steps(folder: Path, name: str, time_s: np.ndarray, is_packed: bool = True, **channels) -> None:
    """Write steps at these times (n,), each channel with its values (n,); the estimates are zero."""
    source = StepSource(LAYOUT, tuple(channels), {"hash": "abc", "instance": "00000001"})
    rows, files = np.zeros(len(time_s), source.dtype), StepAppender(folder, name, source)
    rows["time_s"], rows["sequence"] = time_s, np.arange(len(time_s))
    for k, values in enumerate(channels.values()):
        rows["values"][:, k] = values
    while len(rows):
        rows = rows[files.append(rows) :]
    files.close()
    if is_packed:
        pack_closed(folder, name)
