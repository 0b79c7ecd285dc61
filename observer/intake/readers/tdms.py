"""TDMS of LabVIEW and DIAdem: waveforms with a clock of their own, or columns beside one of times."""

from __future__ import annotations

import logging
from pathlib import Path
from typing import Any

import numpy as np

from observer.frames import FloatArray
from observer.intake.sheets import RawColumn, Sheet


def read_tdms(path: Path) -> list[Sheet]:
    """Read the channels of a TDMS file, those of one clock in a sheet.

    Channels share a clock if they have the same length, start and step. Their times count from 1970 if the
    waveform has a start; without a step a column must hold them.

    Raises:
        ValueError: The file is damaged; nptdms raises other errors too.
    """
    from nptdms import TdmsFile  # noqa: PLC0415 - of an extra
    from nptdms.log import log_manager  # noqa: PLC0415

    log_manager.set_level(logging.CRITICAL)  # nptdms would print damaged bytes to the terminal
    file = TdmsFile.read(path)
    return [sheet for group in file.groups() for sheet in _group(path, group)]


def _group(path: Path, group: Any) -> list[Sheet]:
    """Return a sheet for each clock of a group's channels: those of the same length, start and step.

    Times are in s, since 1970 where the waveform has a start time; None without a step.
    """
    clocks: dict[Any, tuple[FloatArray | None, bool, list[RawColumn]]] = {}
    for channel in group.channels():
        if not len(channel):
            continue
        properties = channel.properties
        start, step = properties.get("wf_start_time"), properties.get("wf_increment")
        clocked = bool(step)
        key = (len(channel), str(start) if clocked else "", step if clocked else None)
        if key not in clocks:
            time_s = None
            since = float(properties.get("wf_start_offset") or 0.0)
            if clocked:
                time_s = since + float(step) * np.arange(len(channel))
                if start is not None:
                    time_s += np.datetime64(start, "ns").astype(np.int64) / 1e9
            clocks[key] = (None if time_s is None else np.asarray(time_s, np.float64), start is not None, [])
        unit = str(properties.get("unit_string") or properties.get("NI_UnitDescription") or "")
        clocks[key][2].append(_column(channel, unit))
    return [
        Sheet(
            path, group.name if len(clocks) < 2 else f"{group.name} {i}", tuple(columns), time_s, since_1970
        )
        for i, (time_s, since_1970, columns) in enumerate(clocks.values(), 1)
    ]


def _column(channel: Any, unit: str) -> RawColumn:
    cells = np.asarray(channel[:])
    if cells.dtype.kind == "M":
        return RawColumn(channel.name, cells.astype("datetime64[ns]"), unit, utc=True)
    if cells.dtype.kind in "OUS":
        import pyarrow as pa  # noqa: PLC0415

        return RawColumn(channel.name, pa.array([str(cell) or None for cell in cells], pa.string()), unit)
    return RawColumn(channel.name, cells.astype(np.float64), unit)
