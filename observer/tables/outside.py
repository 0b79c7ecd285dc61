"""Classes from outside the package, which a configuration names as `kind = "module:Class"`."""

from __future__ import annotations

import importlib
import re
from typing import Any, TypeGuard

_NAME = re.compile(r"[A-Za-z_]\w*(\.[A-Za-z_]\w*)*:[A-Za-z_]\w*", re.ASCII)


def is_outside(kind: object) -> TypeGuard[str]:
    """Whether a `kind` names a class from outside."""
    return isinstance(kind, str) and _NAME.fullmatch(kind) is not None


def outside(kind: str) -> Any:
    """Import the class that `kind` names.

    Raises `ValueError` with the remedy where it cannot be imported, whatever its module raises.
    """
    module, _, name = kind.partition(":")
    try:
        return getattr(importlib.import_module(module), name)
    except AttributeError:
        raise ValueError(f"{module} has no class {name}; fix the name after the colon") from None
    except Exception as error:  # noqa: BLE001 - the module is not ours and may raise anything
        raise ValueError(
            f"{kind} cannot be imported ({type(error).__name__}: {error}); install its package beside this "
            "program, or put its folder on PYTHONPATH"
        ) from None
