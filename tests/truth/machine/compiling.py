"""Compiled loops whose cache on disk knows every source that they were compiled from.

numba looks at the file of the function alone: a constant changed in another file would go unnoticed.
"""

from __future__ import annotations

import inspect
import sys
import zlib
from collections.abc import Callable
from types import ModuleType
from typing import Any

from numba import njit


def cached(*modules: ModuleType) -> Callable[[Callable[..., Any]], Any]:
    """Compile a loop once for its own source and those of the modules that it calls into."""

    def decorate(function: Callable[..., Any]) -> Any:
        sources = [inspect.getsource(m) for m in (sys.modules[function.__module__], *modules)]
        function.__qualname__ += f"-{zlib.crc32(''.join(sources).encode()):08x}"
        return njit(cache=True)(function)

    return decorate
