"""A missing optional package as one sentence."""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import ParamSpec, TypeVar

from observer.errors import UserError, install_remedy

Arguments = ParamSpec("Arguments")
Answer = TypeVar("Answer")
_WITHOUT_EXTRA = ("pandas", "xarray")
"""Packages in no extra, since only some users need them."""


def in_words(work: Callable[Arguments, Answer]) -> Callable[Arguments, Answer]:
    """Make a function raise `UserError` with the remedy if it needs a package that is not installed.

    The wrapper lets `ModuleNotFoundError` pass for a package that no extra contains: that is a defect.

    Args:
        work: A function or method; name, docstring and signature stay.
    """

    @functools.wraps(work)
    def wrapped(*args: Arguments.args, **kwargs: Arguments.kwargs) -> Answer:
        try:
            return work(*args, **kwargs)
        except ModuleNotFoundError as error:
            name = (error.name or "").partition(".")[0]
            sentence = install_remedy(work.__name__, error)
            if name in _WITHOUT_EXTRA:
                sentence = f"{work.__name__} needs {name}: pip install {name}"
            if sentence is None:
                raise
            raise UserError(sentence) from None

    return wrapped
