"""Reading a configuration's file, whatever it is that the path leads to."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

from observer.errors import ConfigError, UserError
from observer.files.regular import one_line, read_regular

MOST_BYTES = 4_000_000
MOST_DEPTH = 24


def read_toml(path: Path, what: str = "a configuration with --config") -> dict[str, Any]:
    """Return the table of a TOML file, `what` it is to be. Raises `ConfigError`."""
    try:
        table = tomllib.loads(read_regular(path, MOST_BYTES, "a TOML file").decode("utf-8"))
    except FileNotFoundError:
        raise ConfigError(f"{path}: no such file; give the path of {what}") from None
    except UnicodeDecodeError as error:
        raise ConfigError(f"{path}: cannot be read as text ({error}); give a TOML file in UTF-8") from None
    except OSError as error:
        reason = error.strerror or error
        raise ConfigError(f"{path}: cannot be read as text ({reason}); give a TOML file in UTF-8") from None
    except UserError as error:
        raise ConfigError(str(error)) from None
    except RecursionError:
        raise ConfigError(f"{path}: tables in tables without end; a configuration is flat") from None
    except ValueError as error:  # not TOML, a number of thousands of digits, a path that no file can have
        reason = one_line(str(error))
        raise ConfigError(f"{path}: not valid TOML ({reason}); mend that line") from None
    if _depth(table) > MOST_DEPTH:
        raise ConfigError(f"{path}: holds more than {MOST_DEPTH} tables in tables; a configuration is flat")
    return table


def _depth(table: Any) -> int:
    """How deep tables and lists lie in each other; counted without recursion, and no further than needed."""
    level, depth = [table], 0
    while level and depth <= MOST_DEPTH:
        depth += 1
        level = [
            inner
            for one in level
            for inner in (one.values() if isinstance(one, dict) else one)
            if isinstance(inner, dict | list)
        ]
    return depth
