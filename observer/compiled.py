"""The one door to numba: compiled functions, cached on disk so that what is cached cannot be stale.

numba checks the file and the code of the function it compiled, not what that calls, which constants it holds
nor how the records are laid out that it takes. Here all of that is worked out from the function itself, when
it is first needed, and is part of the name of the file in which its machine code is kept.
"""

# numba tells nothing of its types.
# mypy: disable-error-code="no-untyped-call, attr-defined"

from __future__ import annotations

import hashlib
import sys
from collections.abc import Callable, Iterable, Iterator
from types import CodeType, FunctionType, ModuleType
from typing import Any

import numpy as np
from numba import njit
from numba.core import types
from numba.core.caching import FunctionCache, IndexDataCacheFile
from numba.core.dispatcher import Dispatcher

Decorator = Callable[[Callable[..., Any]], Any]

# For what is called inside the loops: compiled into them, so nothing is cached apart. `rarely` is for what
# runs once in a while and would only make the loops longer to compile.
# Nothing in here allocates, so references need no counting; counting them took half of a step's time.
_OPTIONS: dict[str, Any] = {"error_model": "numpy", "_nrt": False}
# A step of many modes, or a replay's block, must not keep the threads from their wires.
_GIL: dict[str, Any] = {"nogil": True}
inlined: Decorator = njit(forceinline=True, **_OPTIONS)
rarely: Decorator = njit(**_OPTIONS)
_NOT_OURS = sys.stdlib_module_names | {"numpy", "numba", "llvmlite"}


def cached_loop(function: Callable[..., Any]) -> Any:
    """Compile a loop that allocates nothing on first use, and keep it on disk."""
    return _kept(function, **_OPTIONS)


def cached_call(function: Callable[..., Any]) -> Any:
    """Compile a function that makes arrays of its own on first use, and keep it on disk."""
    return _kept(function)


def _kept(function: Callable[..., Any], **options: Any) -> Any:
    settings = _GIL | options
    compiled = njit(**settings)(function)
    compiled._cache = _Cache(function)
    return compiled


class _Cache(FunctionCache):
    """numba's own, in files whose names tell all that the machine code was made from.

    What is in other files is never read: it may tell of records that are no more.
    """

    def _load_overload(self, sig: Any, target_context: Any) -> Any:
        self._open(sig)
        return super()._load_overload(sig, target_context)

    def _save_overload(self, sig: Any, data: Any) -> None:
        self._open(sig)
        super()._save_overload(sig, data)

    def _open(self, sig: Any) -> None:
        made_of = repr((fingerprint(self._py_func), *_records(sig)))
        name = f"{self._impl.filename_base}-{hashlib.sha256(made_of.encode()).hexdigest()[:16]}"
        stamp = self._impl.locator.get_source_stamp()
        self._cache_file = IndexDataCacheFile(self._cache_path, name, stamp)


def _records(kinds: Iterable[Any]) -> Iterator[tuple[str, ...]]:
    """Yield the names of every record among numba's types and of its columns, in their order."""
    for kind in kinds:
        if isinstance(kind, types.BaseNamedTuple):
            yield kind.instance_class.__module__, kind.instance_class.__qualname__, *kind.fields
        if isinstance(kind, types.BaseTuple):
            yield from _records(kind.types)


def fingerprint(function: Callable[..., Any]) -> str:
    """Return a digest of a function's code, of all that it calls and of every constant that they hold.

    Raises `TypeError` for a global of a kind that a compiled function has no business with.
    """
    digest = hashlib.sha256()
    for part in _of_function(function, set()):
        digest.update(part.encode() + b"\0")
    return digest.hexdigest()


def _of_function(function: Any, seen: set[int]) -> Iterator[str]:
    if id(function) in seen:
        return
    seen.add(id(function))
    names = sorted(_names(function.__code__))
    yield from _of_code(function.__code__)
    yield repr((function.__defaults__, function.__kwdefaults__))
    for cell in function.__closure__ or ():
        yield from _of_value(cell.cell_contents, names, seen)
    for name in names:
        if name in function.__globals__:
            yield name
            yield from _of_value(function.__globals__[name], names, seen)


def _of_code(code: CodeType) -> Iterator[str]:
    yield code.co_code.hex()
    yield repr((code.co_names, code.co_varnames, code.co_freevars, code.co_cellvars))
    for constant in code.co_consts:
        yield from _of_code(constant) if isinstance(constant, CodeType) else _of_value(constant, [], set())


def _names(code: CodeType) -> set[str]:
    """The globals and attributes that a code uses, with those of the functions inside it."""
    inner = (_names(constant) for constant in code.co_consts if isinstance(constant, CodeType))
    return set(code.co_names).union(*inner)


def _of_value(value: Any, names: list[str], seen: set[int]) -> Iterator[str]:
    """What a value adds to a fingerprint; of a module, only what is used under one of the names."""
    if isinstance(value, Dispatcher):
        yield repr(sorted(value.targetoptions.items()))
        yield from _of_function(value.py_func, seen)
    elif _is_foreign(value):
        yield f"{getattr(value, '__module__', '')}.{getattr(value, '__qualname__', value)}"
    elif isinstance(value, FunctionType):
        yield from _of_function(value, seen)
    elif isinstance(value, ModuleType):
        for name in names:
            if name in vars(value):
                yield from _of_value(vars(value)[name], names, seen)
    elif isinstance(value, type):
        yield repr(
            (value.__qualname__, getattr(value, "_fields", ()), list(getattr(value, "__members__", ())))
        )
    elif isinstance(value, np.ndarray):
        yield repr((value.dtype.str, value.shape, value.tobytes()))
    elif isinstance(value, tuple | list | frozenset):
        for item in sorted(value, key=repr) if isinstance(value, frozenset) else value:
            yield from _of_value(item, names, seen)
    elif value is None or isinstance(value, bool | int | float | str | bytes | np.generic | type(...)):
        yield repr(value)
    else:
        raise TypeError(f"a compiled function holds {value!r}, of which no fingerprint can be taken")


def _is_foreign(value: Any) -> bool:
    """Whether a module, class or function is not of this house: it changes with its version only."""
    if isinstance(value, ModuleType):
        return value.__name__.partition(".")[0] in _NOT_OURS
    if not isinstance(value, type) and not callable(value):
        return False
    return str(getattr(value, "__module__", None) or "builtins").partition(".")[0] in _NOT_OURS
