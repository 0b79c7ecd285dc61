"""A missing optional package as one sentence."""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import ParamSpec, TypeVar

from observer.errors import UserError, install_remedy

Given = ParamSpec("Given")
Answer = TypeVar("Answer")
_BY_THEMSELVES = ("pandas", "xarray")
"""Packages in no extra, since only some users need them."""


def in_words(work: Callable[Given, Answer]) -> Callable[Given, Answer]:
    """Make a function raise `UserError` with the remedy where it needs a package that is not installed."""

    @functools.wraps(work)
    def wrapped(*args: Given.args, **kwargs: Given.kwargs) -> Answer:
        try:
            return work(*args, **kwargs)
        except ModuleNotFoundError as error:
            name = (error.name or "").partition(".")[0]
            sentence = install_remedy(work.__name__, error)
            if name in _BY_THEMSELVES:
                sentence = f"{work.__name__} needs {name}: pip install {name}"
            if sentence is None:
                raise
            raise UserError(sentence) from None

    return wrapped
