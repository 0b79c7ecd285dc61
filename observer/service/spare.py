"""What the daemon does without: what libraries take along unasked, and code that has done its work."""

from __future__ import annotations

import ctypes
import gc
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

_DONTNEED = 4  # of madvise: what a file holds is read from it again
_COMPILER = "libllvmlite.so"


def import_sparingly() -> None:
    """Import structlog without rich's tracebacks, numba without YAML, coverage and scipy's BLAS.

    No garbage is looked for until `leave_in_peace`: what is imported stays.
    """
    gc.disable()
    with _not_found("rich", "yaml", "coverage", "scipy.linalg"):
        import numba.np.arraymath  # noqa: F401, PLC0415
        import structlog  # noqa: F401, PLC0415


@contextmanager
def _not_found(*names: str) -> Iterator[None]:
    """A block in which modules cannot be imported, if they are not there yet."""
    hidden = [name for name in names if name not in sys.modules]
    sys.modules.update(dict.fromkeys(hidden))  # type: ignore[arg-type]  # None says so to `import`
    try:
        yield
    finally:
        for name in hidden:
            del sys.modules[name]


def leave_in_peace() -> None:
    """Keep what is there now out of all later garbage collections, a full one of which takes 0.1 s.

    What only the start needed goes back to the system: freed memory, and the code of the compiler.
    """
    if gc.get_freeze_count():  # of parts that were there before
        gc.unfreeze()
        gc.collect()
    gc.freeze()
    gc.enable()
    with suppress(OSError, AttributeError):  # a system without these has them not given back
        libc = ctypes.CDLL(None)
        libc.malloc_trim(0)
        for start, end in _code_of(_COMPILER):
            libc.madvise(ctypes.c_void_p(start), ctypes.c_size_t(end - start), _DONTNEED)


def _code_of(library: str) -> Iterator[tuple[int, int]]:
    """Where the instructions of a library lie, which are never written to."""
    for line in Path("/proc/self/maps").read_text().splitlines():
        place, rights, *_ = line.split(maxsplit=2)
        if rights == "r-xp" and line.endswith(f"/{library}"):
            start, end = place.split("-")
            yield int(start, 16), int(end, 16)
