"""The errors a user sees, each a sentence that names the place and the remedy."""

from __future__ import annotations

import difflib
import importlib.util
from collections.abc import Iterable, Sequence

EXTRAS = {
    "analysis": ("control", "filterpy", "matplotlib", "pyarrow"),
    "page": ("starlette", "uvicorn"),
    "plant": ("prometheus_client", "uvicorn", "paho", "asyncua", "httpx", "defusedxml"),
    "fleet": ("distributed",),
    "logs": ("pint", "charset_normalizer", "dateutil", "python_calamine", "nptdms", "asammdf"),
}
"""The packages of each extra in `pyproject.toml`; the daemon needs none of them."""


class UserError(Exception):
    """Something outside the program is wrong and the user can fix it.

    The command line prints the message as it stands and exits with code 2.
    """


class ConfigError(UserError):
    """A configuration cannot be used; the message names file, key and remedy.

    Several problems are listed below the file's name, one per line.
    """


class SeveralError(ValueError):
    """The problems that one check of a table found.

    Attributes:
        problems: A sentence each, without the place.
    """

    def __init__(self, problems: Sequence[str]) -> None:
        super().__init__("; ".join(problems))
        self.problems = tuple(problems)


def raise_all(problems: Sequence[str]) -> None:
    """Raise all problems of a check at once.

    Raises:
        SeveralError: There is at least one problem.
    """
    if problems:
        raise SeveralError(problems)


class LogError(UserError):
    """A log cannot be used; the message names file, row or column, and remedy."""


def meant(word: str, choices: Iterable[str]) -> str:
    """Return “ (did you mean …?)” with the choice closest to a word; empty if none is close."""
    close = difflib.get_close_matches(word, list(choices), n=1)
    return f" (did you mean {close[0]}?)" if close else ""


def check_choice(option: str, value: object, choices: Sequence[str]) -> None:
    """Refuse a value of an option that is not one of its choices.

    Args:
        option: Its name, for the error.
        value: The given value.
        choices: All that are allowed.

    Raises:
        UserError: The value is another; the sentence lists the choices.
    """
    if value not in choices:
        raise UserError(
            f"{option} = {value!r} is not known{meant(str(value), choices)}; give {' or '.join(choices)}"
        )


def has_extra(name: str) -> bool:
    """Return whether the packages of an extra are installed, without importing them."""
    return all(importlib.util.find_spec(module) is not None for module in EXTRAS[name])


def extra_remedy(extra: str) -> str:
    """Return how to install the packages of an extra: from the wheel, as no package index has the program."""
    return f'install the wheel again as "<wheel>[{extra}]"'


def install_remedy(command: str, error: ModuleNotFoundError) -> str | None:
    """Return how to install a missing package; None if no extra contains it, which is a defect.

    Args:
        command: The command or function that needs it, for the sentence.
        error: The failed import.
    """
    missing = (error.name or "").partition(".")[0]
    for extra, modules in EXTRAS.items():
        if missing in modules:
            return f"{command} needs the packages of {extra} ({missing} is missing): {extra_remedy(extra)}"
    return None
