"""Files named in a configuration that hold keys, certificates, names and passwords: read and checked."""

from __future__ import annotations

from pathlib import Path

from observer.errors import ConfigError


def read_named(path: Path, key: str, *, secret: bool = False) -> bytes:
    """The bytes of a file that a configuration names under a key; a `secret` belongs to its owner alone.

    Raises `ConfigError` where it cannot be read, or others can read it.
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
        raise ConfigError(f"{key}: {path} is no text in UTF-8; write it anew") from None


def read_password(path: Path, key: str, *, secret: bool = True) -> str:
    """The password in a file, its first line. Raises `ConfigError` where there is none."""
    password = _text(path, key, secret=secret).split("\n", 1)[0].strip()
    if not password:
        raise ConfigError(f"{key}: {path} is empty; write the password into it")
    return password


def read_users(path: Path, key: str) -> dict[str, str]:
    """Names and passwords from a file of `name:password` lines. Raises `ConfigError` where it is none."""
    users = {}
    for number, line in enumerate(_text(path, key).splitlines(), 1):
        name, _, password = line.partition(":")
        if not line.strip():
            continue
        if not name.strip() or not password.strip() or name != name.strip():
            raise ConfigError(f"{key}: {path}, line {number}: write name:password, nothing else")
        users[name] = password.strip()
    if not users:
        raise ConfigError(f"{key}: {path} names nobody; write a line name:password for each user")
    return users
