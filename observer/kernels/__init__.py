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
from types import SimpleNamespace
from typing import Any

from observer.errors import UserError
from observer.kernels.files import digest

VARIABLE = "OBSERVER_KERNELS"
_WAYS = ("any", "avx2", "interpreted")
_REMEDY = "install the package again (`pip install .`; in a clone `make env`)"


class KernelsError(UserError):
    """The compiled kernels cannot run: not built, or of other files than those beside them."""


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
        raise KernelsError(f"{VARIABLE}={way}: it is one of {', '.join(_WAYS)}, or not set")
    if way == "interpreted":
        return way
    if way == "any" or not any((Path(__path__[0]) / "avx2").glob("core.*")):
        return "any"
    return "avx2" if way == "avx2" or _has_avx2() else "any"


def _load(way: str) -> dict[str, Any]:
    """Return entries and, but for Python files, records by name."""
    if way == "interpreted":
        modules = (
            "kalman", "fixed_gain", "smoother", "advance", "bank", "changes", "sweep", "exact_step", "path",
            "selftest", "message", "live", "walk", "cells",
        )  # fmt: skip
        entries: dict[str, Any] = {}
        for name in modules:
            entries |= vars(importlib.import_module(f"{__name__}.{name}"))
        return entries
    if way == "avx2":
        __path__.insert(0, str(Path(__path__[0]) / "avx2"))
    try:
        compiled = vars(importlib.import_module(f"{__name__}.core"))
    except ImportError as error:
        raise KernelsError(f"the kernels are not built ({error}); {_REMEDY}") from error
    finally:
        if way == "avx2":
            del __path__[0]
    # kernels of before the first that keep the digest are taken as they are
    if compiled.get("FILES", found := digest(Path(__path__[0]))) != found:
        raise KernelsError(f"the compiled kernels are of other files than those installed; {_REMEDY}")
    return compiled


WAY = _choose()
"""What runs: any, avx2 or interpreted."""
_loaded = _load(WAY)


def record(fields: Any) -> Any:
    """Return what kernels take for a NamedTuple, on the same memory.

    Compiled, it is the class of the same name in `records.pxd` or `tick_records.pxd`, which gives every field
    its type; what the fields are, and of which shape, stands at the NamedTuple.
    """
    values = {
        key: record(value) if hasattr(value, "_asdict") else value for key, value in fields._asdict().items()
    }
    kind = SimpleNamespace if WAY == "interpreted" else _loaded[type(fields).__name__]
    return kind(**values)


def __getattr__(name: str) -> Any:
    """Return an entry of the kernels: `run_kalman`, `march`, `step_frame` and the others."""
    if name in _loaded and not name.startswith("_"):
        return _loaded[name]
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
