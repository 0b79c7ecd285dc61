"""The reports of discover: their list, what each would change, and the page of one."""

from __future__ import annotations

import difflib
import json
import shlex
from pathlib import Path
from typing import Any

_MOST_REPORTS = 100
_MOST_REPORT_BYTES = 20_000_000
_CONTEXT = 3


def reports(folder: Path, config_file: Path | None) -> list[dict[str, Any]]:
    """The reports in a folder, the newest first; a folder that is not there has none.

    Each has `name`, `time_s`, `verdict`, `effects` (their kinds), `has_report`, and, where a configuration is
    proposed, `diff` against the one in force and the `command` that adopts it.
    """
    try:
        results = [path for path in folder.glob("*/result.json") if _is_own(path)]
        timed = sorted(((path.stat().st_mtime, path) for path in results), reverse=True)
    except OSError:
        return []
    return [_report(time_s, path, config_file) for time_s, path in timed[:_MOST_REPORTS]]


def report_html(folder: Path, name: str) -> bytes | None:
    """The report of one of the folders, None where there is none."""
    path = folder / name / "report.html"
    if "/" in name or name in {"", ".", ".."}:
        return None
    try:
        return path.read_bytes() if _is_own(path) and path.stat().st_size <= _MOST_REPORT_BYTES else None
    except OSError:  # a name that is too long for a file, or one that nobody here may read
        return None


def _is_own(path: Path) -> bool:
    """Whether a file of a report lies in its folder, in place of a link to elsewhere."""
    return path.is_file() and not path.is_symlink() and not path.parent.is_symlink()


def _report(time_s: float, path: Path, config_file: Path | None) -> dict[str, Any]:
    found: dict[str, Any] = {
        "name": path.parent.name,
        "time_s": time_s,
        "verdict": "not readable",
        "effects": [],
        "has_report": _is_own(path.with_name("report.html")),
        "diff": None,
        "command": None,
    }
    try:
        result = json.loads(path.read_text(encoding="utf-8"))
        found["verdict"] = str(result["verdict"])
        found["effects"] = [str(effect["kind"]) for effect in result["effects"]]
    except (OSError, ValueError, KeyError, TypeError, RecursionError):
        return found
    proposed = path.with_name("config.toml")
    if config_file is not None and _is_own(proposed):
        found["diff"] = _diff(config_file, proposed)
        found["command"] = shlex.join(["observer", "adopt", str(path.parent), "--config", str(config_file)])
    return found


def _diff(before: Path, after: Path) -> list[str]:
    try:
        one, other = (path.read_text(encoding="utf-8").splitlines() for path in (before, after))
    except (OSError, UnicodeDecodeError) as error:
        return [f"cannot be compared: {error}"]
    return list(difflib.unified_diff(one, other, "in force", "proposed", n=_CONTEXT, lineterm=""))
