"""Compilation for the kernels, with a cache on disk that cannot go stale.

numba checks the file of the function it compiled, not the files of what it inlined nor of the records it
takes: an update there would leave the old code in use. Here the cache's name carries a fingerprint of all
sources involved.
"""

from __future__ import annotations

import inspect
import sys
import zlib
from collections.abc import Callable
from types import ModuleType
from typing import Any

from numba import njit

# For what is called inside the loops: compiled into them, so nothing is cached apart. `rarely` is for what
# runs once in a while and would only make the loops longer to compile.
# Nothing in here allocates, so references need no counting; counting them took half of a step's time.
_OPTIONS: dict[str, Any] = {"error_model": "numpy", "_nrt": False}
# A step of many modes, or a replay's block, must not keep the threads from their wires.
_GIL = {"nogil": True}
inlined = njit(forceinline=True, **_OPTIONS)
rarely = njit(**_OPTIONS)


def cached_loop(*modules: ModuleType, allocates: bool = False) -> Callable[[Callable[..., Any]], Any]:
    """Compile a loop on first use, cached under the sources of its own module and of `modules`."""

    def decorate(function: Callable[..., Any]) -> Any:
        options = _GIL | ({} if allocates else _OPTIONS)
        sources = [inspect.getsource(module) for module in (sys.modules[function.__module__], *modules)]
        fingerprint = zlib.crc32(chr(0).join([repr(options), *sources]).encode())
        function.__qualname__ += f"-{fingerprint:08x}"
        return njit(cache=True, **options)(function)

    return decorate
