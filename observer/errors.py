"""The one kind of error a user sees: a sentence that names the place and the remedy."""


class UserError(Exception):
    """Something outside the program is wrong and its user can mend it.

    The command line prints the message as it stands and exits with code 2.
    """


class ConfigError(UserError):
    """A configuration cannot be used; the message names file, key and remedy."""


class LogError(UserError):
    """A log cannot be used; the message names file, row or column, and remedy."""
