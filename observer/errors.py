"""The one kind of error a user sees: a sentence that names the place and the remedy."""

from collections.abc import Sequence


class UserError(Exception):
    """Something outside the program is wrong and its user can mend it.

    The command line prints the message as it stands and exits with code 2.
    """


class ConfigError(UserError):
    """A configuration cannot be used; the message names file, key and remedy.

    Several problems stand on a line each below the file's name.
    """


class SeveralError(ValueError):
    """What one check of a table found, a sentence for each problem."""

    def __init__(self, problems: Sequence[str]) -> None:
        super().__init__("; ".join(problems))
        self.problems = tuple(problems)


def raise_all(problems: Sequence[str]) -> None:
    """Raise `SeveralError` where there are problems."""
    if problems:
        raise SeveralError(problems)


class LogError(UserError):
    """A log cannot be used; the message names file, row or column, and remedy."""
