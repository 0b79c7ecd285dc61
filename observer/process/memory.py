"""Memory that the daemon saves: modules that libraries import needlessly, and data that only the start
needs.
"""

from __future__ import annotations

import ctypes
import gc
import importlib
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress


def import_sparingly() -> None:
    """Import structlog without rich's tracebacks.

    Garbage collection is off until `leave_in_peace`, since imported modules stay.
    """
    gc.disable()
    with not_found("rich"):
        import structlog  # noqa: F401, PLC0415


@contextmanager
def not_found(*names: str) -> Iterator[None]:
    """Run a block in which these modules cannot be imported, unless they are loaded already."""
    hidden = [name for name in names if name not in sys.modules]
    sys.modules.update(dict.fromkeys(hidden))  # type: ignore[arg-type]  # None says so to `import`
    try:
        yield
    finally:
        for name in hidden:
            del sys.modules[name]


def import_mf4() -> None:
    """Make python-can read MF4 even if it was imported under `not_found("asammdf")`.

    Raises `ModuleNotFoundError` if asammdf is not installed.
    """
    import can.io.mf4  # noqa: PLC0415 - before asammdf, which imports can in the middle of its own import

    if getattr(can.io.mf4, "asammdf", None) is None:
        import asammdf  # noqa: F401, PLC0415 - of an extra

        importlib.reload(can.io.mf4)


def leave_in_peace() -> None:
    """Exclude all present objects from later garbage collections, a full one of which would delay a tick.

    Memory that only the start needed is returned to the system.
    """
    if gc.get_freeze_count():  # of parts that were there before
        gc.unfreeze()
        gc.collect()
    gc.freeze()
    gc.enable()
    with suppress(OSError, AttributeError):  # a system without this has it not given back
        ctypes.CDLL(None).malloc_trim(0)
