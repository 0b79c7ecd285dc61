"""Classes from outside the package, which a configuration names in `kind`.

Either as `"module:Class"`, or by the name that an installed package gives to its class in the entry-point
group `ballscrew_observer.drivers`, `.estimators`, `.effects` or `.outlets`. A kind of this package has
precedence.
"""

from __future__ import annotations

import re
import sys
import traceback
from importlib.metadata import EntryPoint, entry_points
from typing import Any, TypeGuard

_PATH = re.compile(r"[A-Za-z_]\w*(\.[A-Za-z_]\w*)*:[A-Za-z_]\w*", re.ASCII)

_FILES: dict[str, str] = {}
"""The file of each class from outside that is in use, with the `kind` that names it."""


def is_outside(kind: object, group: str) -> TypeGuard[str]:
    """Return whether a `kind` names a class from outside.

    Args:
        kind: Any value of the configuration.
        group: `"drivers"`, `"estimators"`, `"effects"` or `"outlets"`.
    """
    return isinstance(kind, str) and (_PATH.fullmatch(kind) is not None or kind in entry_names(group))


def entry_names(group: str) -> tuple[str, ...]:
    """Return the names that installed packages give to their classes of a group, sorted.

    Args:
        group: `"drivers"`, `"estimators"`, `"effects"` or `"outlets"`.
    """
    return tuple(sorted(entry_points(group=f"ballscrew_observer.{group}").names))


def outside(kind: str, group: str) -> Any:
    """Import the class that `kind` names, and remember its file for `fault_outside`.

    Args:
        kind: `module:Class`, or the name of an entry point.
        group: `"drivers"`, `"estimators"`, `"effects"` or `"outlets"`.

    Raises:
        ValueError: If it cannot be imported, whatever its module raises, if the module has no such class, or
            if abstract methods are missing.
    """
    point = EntryPoint(kind, kind, group)
    if ":" not in kind:
        point = entry_points(group=f"ballscrew_observer.{group}")[kind]
    try:
        loaded = point.load()
    except AttributeError:
        raise ValueError(f"{point.module} has no class {point.attr}; fix the name after the colon") from None
    except Exception as error:  # noqa: BLE001 - the module is not ours and may raise anything
        raise ValueError(
            f"{kind} cannot be imported ({type(error).__name__}: {error}); install its package beside this "
            "program, or put its folder on PYTHONPATH"
        ) from None
    if missing := sorted(getattr(loaded, "__abstractmethods__", ())):
        raise ValueError(f"{kind} has no {' and no '.join(missing)}; write what its base class demands")
    _FILES[str(getattr(sys.modules[point.module], "__file__", point.module))] = kind
    return loaded


def fault_outside(error: BaseException) -> str | None:
    """Return a sentence that names the class from outside in which an exception arose, with file and line.

    Args:
        error: The exception with its traceback.

    Returns:
        The sentence, or None if no class from outside is involved.
    """
    for frame in reversed(traceback.extract_tb(error.__traceback__)):
        if kind := _FILES.get(frame.filename):
            return (
                f"{kind} failed in {frame.filename}, line {frame.lineno} ({type(error).__name__}: {error}); "
                "correct this class, which is not part of the program"
            )
    return None
