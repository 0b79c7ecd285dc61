"""Arithmetic that runs at every step, compiled when the package is built; as Python it gives the same bits.

The files of this package are plain Python. `setup.py` makes one extension of them, `core`, for any processor
and, on x86-64, once more for those with AVX2 in the folder `avx2`; which one fits is chosen here. The
environment variable `OBSERVER_KERNELS` chooses otherwise: `any`, `avx2`, or `interpreted` for the Python
files themselves, as tests of single lines need them (that takes Cython's module `cython`).
"""

from __future__ import annotations

import importlib
import os
from pathlib import Path
from typing import Any

from observer.kernels.codes import DONE

VARIABLE = "OBSERVER_KERNELS"
_WAYS = ("any", "avx2", "interpreted")


def _has_avx2() -> bool:
    """Whether this processor, and its operating system, know AVX2: numpy has looked."""
    try:
        from numpy._core._multiarray_umath import (  # type: ignore[import-not-found]  # noqa: PLC0415
            __cpu_features__,
        )
    except ImportError:
        return False
    return bool(__cpu_features__.get("AVX2", False))


def _choose() -> str:
    way = os.environ.get(VARIABLE, "")
    if way and way not in _WAYS:
        raise ImportError(f"{VARIABLE}={way}: it is one of {', '.join(_WAYS)}, or not set")
    if way == "interpreted":
        return way
    if way == "any" or not any((Path(__path__[0]) / "avx2").glob("core.*")):
        return "any"
    return "avx2" if way == "avx2" or _has_avx2() else "any"


def _load(way: str) -> tuple[Any, Any]:
    """Return where the entries and where the records are."""
    if way == "interpreted":
        modules = (
            "entries", "bank", "changes", "discretise", "moving", "path", "selftest", "stepwise", "message",
            "live", "cells",
        )  # fmt: skip
        entries: dict[str, Any] = {}
        for name in modules:
            entries |= vars(importlib.import_module(f"{__name__}.{name}"))
        records = (importlib.import_module(f"{__name__}.{name}") for name in ("records", "tick_records"))
        return entries, {name: kind for module in records for name, kind in vars(module).items()}
    if way == "avx2":
        __path__.insert(0, str(Path(__path__[0]) / "avx2"))
    try:
        core = vars(importlib.import_module(f"{__name__}.core"))
    except ImportError as error:
        raise ImportError(
            f"observer's kernels are not built ({error}): install the package (`pip install .`) or `make env`"
        ) from error
    finally:
        if way == "avx2":
            del __path__[0]
    return core, core


WAY = _choose()
"""What runs: any, avx2 or interpreted."""
_entries, _records = _load(WAY)


def record(fields: Any) -> Any:
    """Return the kernels' record on the same memory as a NamedTuple, by whose name it goes."""
    values = {
        key: record(value) if hasattr(value, "_asdict") else value for key, value in fields._asdict().items()
    }
    return _records[type(fields).__name__](**values)


run_kalman = _entries["run_kalman"]
run_bank = _entries["run_bank"]
run_until_due = _entries["run_until_due"]
pour = _entries["pour"]
put_bounds = _entries["put_bounds"]
run_fixed_gain = _entries["run_fixed_gain"]
run_forward = _entries["run_forward"]
run_backward = _entries["run_backward"]
run_tolerances = _entries["run_tolerances"]
run_changes_forward = _entries["run_changes_forward"]
run_changes_backward = _entries["run_changes_backward"]
march = _entries["march"]
discretise = _entries["discretise"]
number_steps = _entries["number_steps"]
follow_path = _entries["follow_path"]
average_on = _entries["average_on"]
add_columns = _entries["add_columns"]
drive_on = _entries["drive_on"]
put_reading = _entries["put_reading"]
tick_on = _entries["tick_on"]
walk_on = _entries["walk_on"]
step_frame = _entries["step_frame"]
encode = _entries["encode"]
compare_ways = _entries["compare_ways"]
run_selftest = _entries["run_selftest"]
find_heats_stepwise = _entries["find_heats_stepwise"]
read_rows = _entries["read_rows"]

__all__ = [
    "DONE", "WAY", "add_columns", "average_on", "compare_ways", "discretise", "drive_on", "encode",
    "find_heats_stepwise", "follow_path", "march", "number_steps", "pour", "put_bounds", "put_reading",
    "read_rows", "record", "run_backward", "run_bank", "run_changes_backward", "run_changes_forward",
    "run_fixed_gain", "run_forward", "run_kalman", "run_selftest", "run_tolerances", "run_until_due",
    "step_frame", "tick_on", "walk_on",
]  # fmt: skip
