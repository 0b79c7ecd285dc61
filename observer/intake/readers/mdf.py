"""Signals of MDF 3 and 4: a sheet for each group, as each has a clock of its own."""

from __future__ import annotations

import gc
import sys
from pathlib import Path
from typing import Any

import numpy as np

from observer.errors import LogError
from observer.files.regular import one_line
from observer.intake.sheets import RawColumn, Sheet
from observer.process.memory import import_mf4


def has_signals(path: Path) -> bool:
    """Return whether an MDF file holds signals, and not the frames of a bus.

    Raises:
        LogError: The file is damaged.
    """
    mdf = _opened(path)
    try:
        return not any(getattr(mdf, "bus_logging_map", {}).values())
    finally:
        mdf.close()


def read_mdf(path: Path) -> list[Sheet]:
    """Read the signals of an MDF file: a sheet for each group, its times in s since 1970.

    Samples marked as invalid are missing. Signals that are arrays are left out.

    Raises:
        LogError: The file is damaged.
    """
    mdf = _opened(path)
    try:
        start_s = mdf.header.start_time.timestamp()
        groups = range(len(mdf.groups))
        sheets = [_sheet(path, mdf, i, start_s) for i in groups]
    except Exception as error:  # noqa: BLE001 - whatever the library stumbles over in a damaged file
        raise LogError(f"{path}: damaged MDF ({one_line(str(error))}); copy it again") from None
    finally:
        mdf.close()
    return [sheet for sheet in sheets if sheet is not None]


def _opened(path: Path) -> Any:
    """Return an open MDF file. Raises `LogError` where asammdf cannot read it."""
    import logging  # noqa: PLC0415

    import_mf4()
    logging.getLogger("asammdf").setLevel(logging.CRITICAL)
    from asammdf import MDF  # noqa: PLC0415 - of an extra

    problem, hook = "", sys.unraisablehook
    sys.unraisablehook = lambda _: None  # what it opened by half stumbles over itself when it is collected
    try:
        return MDF(path)
    except Exception as error:  # noqa: BLE001 - as above
        problem = one_line(str(error))
    finally:
        if problem:
            gc.collect()
        sys.unraisablehook = hook
    raise LogError(f"{path}: damaged or not MDF ({problem}); copy it again")


def _sheet(path: Path, mdf: Any, number: int, start_s: float) -> Sheet | None:
    """The signals of one group; None where it has none."""
    group = mdf.groups[number]
    master = mdf.masters_db.get(number)
    columns, time_s = [], None
    for index in range(len(group.channels)):
        if index == master:
            continue
        signal = mdf.get(group=number, index=index, ignore_invalidation_bits=False)
        if signal.samples.ndim != 1:
            continue
        time_s = np.asarray(signal.timestamps, dtype=np.float64)
        columns.append(RawColumn(signal.name, _values(signal), signal.unit or ""))
    if time_s is None:
        return None
    name = getattr(group.channel_group, "acq_name", "") or f"group {number + 1}"
    return Sheet(path, name, tuple(columns), start_s + time_s)


def _values(signal: Any) -> Any:
    """The samples of a signal, invalid ones missing."""
    samples = signal.samples
    if samples.dtype.kind in "SUO":
        import pyarrow as pa  # noqa: PLC0415

        texts = [s.decode("utf-8", "replace") if isinstance(s, bytes) else str(s) for s in samples]
        return pa.array([text.strip("\0 ") or None for text in texts], pa.string())
    values = samples.astype(np.float64)
    if signal.invalidation_bits is not None:
        values[np.asarray(signal.invalidation_bits, bool)] = np.nan
    return values
