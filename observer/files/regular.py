"""Reads a file named by a user, which may be anything: its bytes, or the table of a TOML file."""

from __future__ import annotations

import os
import re
import stat
import tomllib
from pathlib import Path
from typing import Any

from observer.errors import ConfigError, LogError, UserError
from observer.files.toml_slips import sentence as slip_sentence

MOST_BYTES = 4_000_000
"""Of a configuration or a record of an adoption."""
MOST_DEPTH, MOST_ENTRIES = 24, 50_000
_KEY_PART = r"(?:[A-Za-z0-9_-]++|\"[^\"\n]*+\"|'[^'\n]*+')"
_LONG_KEY = re.compile(
    rf"(?:^|[{{,])[ \t\[]*+{_KEY_PART}(?:[ \t]*+\.[ \t]*+{_KEY_PART}){{{MOST_DEPTH}}}", re.MULTILINE
)
"""A key of more parts; the parser's time grows with the square of their number."""
MOST_LOG_BYTES = 1 << 30
"""Of a log, on disk and unpacked: a day at 20 Hz of twenty channels has a third of it as text."""


def one_line(reason: str) -> str:
    """Return the first line of a library's message about a file, at most 200 characters.

    "?" replaces unprintable characters, so that damaged bytes do not reach a terminal.
    """
    first = reason.strip().split("\n", 1)[0][:200]
    return "".join(c if c.isprintable() else "?" for c in first)


def refuse_irregular(path: Path, remedy: str, opened: int | None = None) -> None:
    """Refuse a path that is not an ordinary file: reading a pipe or a device might never end.

    Args:
        path: The path.
        remedy: What to give instead, for the error.
        opened: The descriptor of the file where that is open already; None to look at the path.

    Raises:
        OSError: The path does not exist.
        UserError: It is a pipe, a device or a folder.
    """
    mode = os.stat(path if opened is None else opened).st_mode
    if not stat.S_ISREG(mode):
        kind = "a folder" if stat.S_ISDIR(mode) else "not an ordinary file"
        raise UserError(f"{path}: cannot be read, it is {kind}; give {remedy}")


def refuse_large(path: Path, size_bytes: int) -> None:
    """Refuse a log that needs more than 1 GiB of memory.

    Args:
        path: The log.
        size_bytes: Its size once unpacked, as far as that is known.

    Raises:
        LogError: The size is larger.
    """
    if size_bytes > MOST_LOG_BYTES:
        raise LogError(
            f"{path}: holds more than {MOST_LOG_BYTES >> 20} MiB once unpacked; split it into shorter logs"
        )


def read_regular(path: Path, most_bytes: int, remedy: str) -> bytes:
    """Return the bytes of an ordinary file.

    Args:
        path: The file.
        most_bytes: The largest size.
        remedy: What to give instead, for the error.

    Raises:
        OSError: The file cannot be read.
        UserError: It is not an ordinary file, or is larger.
    """
    descriptor = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
    with open(descriptor, "rb") as file:
        refuse_irregular(path, remedy, descriptor)
        data = file.read(most_bytes + 1)
    if len(data) > most_bytes:
        raise UserError(f"{path}: is larger than {most_bytes / 1e6:g} MB; give {remedy}")
    return data


def read_toml(path: Path, remedy: str = "a configuration with --config") -> dict[str, Any]:
    """Return the table of a TOML file.

    Args:
        path: The file.
        remedy: The kind of file to give, for the error.

    Raises:
        ConfigError: The file is missing, unreadable, not TOML, too large or too deeply nested. For a line
            that is not TOML the sentence shows how to write it.
    """
    text, data = "", b""
    try:
        data = read_regular(path, MOST_BYTES, "a TOML file")
        text = data.decode("utf-8-sig")  # some editors mark UTF-8 at its beginning
        if _LONG_KEY.search(text):
            raise ConfigError(f"{path}: holds more than {MOST_DEPTH} nested tables; give each a [name]")
        table = tomllib.loads(text)
    except FileNotFoundError:
        raise ConfigError(f"{path}: no such file; give the path of {remedy}") from None
    except UnicodeDecodeError as error:
        line = data.count(b"\n", 0, error.start) + 1
        raise ConfigError(
            f"{path}: line {line} holds a character in another encoding; in the editor, save it as UTF-8"
        ) from None
    except OSError as error:
        reason = error.strerror or error
        raise ConfigError(f"{path}: cannot be read as text ({reason}); give a TOML file in UTF-8") from None
    except UserError as error:
        raise ConfigError(str(error)) from None
    except RecursionError:
        raise ConfigError(f"{path}: tables nested without end; give each a [name] of its own") from None
    except ValueError as error:  # not TOML, a number of thousands of digits, a path that no file can have
        raise ConfigError(f"{path}: {slip_sentence(text, one_line(str(error)))}") from None
    depth, entries = _extent(table)
    if depth > MOST_DEPTH:
        raise ConfigError(f"{path}: holds more than {MOST_DEPTH} nested tables; give each a [name]")
    if entries > MOST_ENTRIES:
        raise ConfigError(f"{path}: holds more than {MOST_ENTRIES} keys and values; give {remedy}")
    return table


def _extent(table: Any) -> tuple[int, int]:
    """How deep tables and lists lie in each other, and the entries they have; counted without recursion, and
    no deeper than needed.
    """
    level, depth, entries = [table], 0, 0
    while level and depth <= MOST_DEPTH:
        depth += 1
        entries += sum(map(len, level))
        level = [
            inner
            for one in level
            for inner in (one.values() if isinstance(one, dict) else one)
            if isinstance(inner, dict | list)
        ]
    return depth, entries


def read_named(path: Path, key: str, *, secret: bool = False) -> bytes:
    """Return the bytes of a file that a configuration names.

    Args:
        path: The file.
        key: The key that names it, for the error.
        secret: Whether it may be readable by its owner only.

    Raises:
        ConfigError: It cannot be read, or is secret and others can read it.
    """
    try:
        mode, data = path.stat().st_mode & 0o777, path.read_bytes()
    except OSError as error:
        raise ConfigError(f"{key}: {path} cannot be read ({error.strerror}); fix or rename it") from None
    if secret and mode & 0o077:
        raise ConfigError(f"{key}: {path} can be read by others (mode {mode:04o}); run chmod 600 {path}")
    return data


def _text(path: Path, key: str, *, secret: bool = True) -> str:
    try:
        return read_named(path, key, secret=secret).decode()
    except UnicodeDecodeError:
        raise ConfigError(f"{key}: {path} is not UTF-8 text; write it again") from None


def read_password(path: Path, key: str, *, secret: bool = True) -> str:
    """Return the password in a file, its first line without blanks around it.

    Args:
        path: The file.
        key: The key that names it, for the error.
        secret: Whether it may be readable by its owner only.

    Raises:
        ConfigError: The file cannot be read, is empty or not UTF-8, or others can read it.
    """
    password = _text(path, key, secret=secret).split("\n", 1)[0].strip()
    if not password:
        raise ConfigError(f"{key}: {path} is empty; write the password into it")
    return password


def read_users(path: Path, key: str) -> dict[str, str]:
    """Return passwords by name from a file of `name:password` lines, readable by its owner only.

    Args:
        path: The file.
        key: The key that names it, for the error.

    Raises:
        ConfigError: The file cannot be read, others can read it, a line has another form, or no line has a
            user.
    """
    users = {}
    for number, line in enumerate(_text(path, key).splitlines(), 1):
        name, _, password = line.partition(":")
        if not line.strip():
            continue
        if not name.strip() or not password.strip() or name != name.strip():
            raise ConfigError(f"{key}: {path}, line {number}: write name:password, nothing else")
        users[name] = password.strip()
    if not users:
        raise ConfigError(f"{key}: {path} names no user; write a line name:password for each")
    return users
