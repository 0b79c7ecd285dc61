"""Arithmetic that runs at every step, compiled when the package is built.

`setup.py` compiles the files of this package into one extension, `core`, for any processor and, on x86-64,
once more for those with AVX2 in the folder `avx2`. This module loads the one that suits the processor. The
environment variable `OBSERVER_KERNELS` overrides the choice: `any` or `avx2`.
"""

from __future__ import annotations

import importlib
import os
from pathlib import Path
from typing import Any

from observer.errors import UserError
from observer.kernels.files import digest

VARIABLE = "OBSERVER_KERNELS"
_WAYS = ("any", "avx2")
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
    if way == "any" or not any((Path(__path__[0]) / "avx2").glob("core.*")):
        return "any"
    return "avx2" if way == "avx2" or _has_avx2() else "any"


def _load(way: str) -> dict[str, Any]:
    """Return entries and records by name."""
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
    if compiled.get("FILES", installed := digest(Path(__path__[0]))) != installed:
        raise KernelsError(f"the compiled kernels are of other files than those installed; {_REMEDY}")
    return compiled


WAY = _choose()
"""The build that runs: any or avx2."""
_loaded = _load(WAY)


def record(fields: Any) -> Any:
    """Return what kernels take for a NamedTuple, on the same memory.

    It is the class of the same name in `records.pxd` or `tick_records.pxd`, which gives every field its type.
    The NamedTuple describes the fields and their shapes.
    """
    values = {
        key: record(value) if hasattr(value, "_asdict") else value for key, value in fields._asdict().items()
    }
    return _loaded[type(fields).__name__](**values)


def __getattr__(name: str) -> Any:
    """Return an entry of the kernels: `run_kalman`, `march`, `step_frame` and the others."""
    if name in _loaded and not name.startswith("_"):
        return _loaded[name]
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
