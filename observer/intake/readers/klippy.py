"""The statistics in `klippy.log` of Klipper: a line a second, its values by name."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from observer.intake.sheets import RawColumn, Sheet

_STATS = re.compile(r"^Stats (\d+(?:\.\d+)?): (.*)$")
_START = re.compile(r"^Start printer at .*\((\d+\.\d+) (\d+\.\d+)\)\s*$")
_VALUE = re.compile(r"^([+-]?\d+(?:\.\d+)?(?:e[+-]?\d+)?)$")
_TEMPERATURES = ("temp", "target")
_OF_ALL = frozenset({"gcodein", "sysload", "cputime", "memavail", "print_time", "buffer_time", "print_stall"})
"""Names that stand behind the values of a group and do not belong to it."""


def recognises(text: str) -> bool:
    """Return whether a text is such a log, by its first words or its lines of statistics."""
    return text.startswith(("Starting Klippy", "Stats ", "Start printer at ")) or (
        "\nStats " in text and "sysload=" in text
    )


def read(path: Path, text: str) -> list[Sheet]:
    """Read the statistics of a log: `chamber.temp`, `heater_bed.target` and so on.

    Times count from 1970 if the log has the start of the printer, else from the computer's start.
    Temperatures have the unit degC, the others none.
    """
    rows, lines, times = list[dict[str, float]](), list[int](), list[float]()
    since_1970_s = None
    for number, line in enumerate(text.split("\n"), 1):
        if start := _START.match(line):
            since_1970_s = float(start[1]) - float(start[2])
        elif stats := _STATS.match(line):
            rows.append(_values(stats[2]))
            lines.append(number)
            times.append(float(stats[1]) + (since_1970_s or 0.0))
    names = list(dict.fromkeys(name for row in rows for name in row))
    columns = [
        RawColumn(
            name,
            np.array([row.get(name, np.nan) for row in rows]),
            "degC" if name.rpartition(".")[2] in _TEMPERATURES else "",
        )
        for name in names
    ]
    return [
        Sheet(
            path,
            "",
            tuple(columns),
            np.array(times),
            since_1970=since_1970_s is not None,
            lines=np.array(lines, np.int64),
        )
    ]


def _values(text: str) -> dict[str, float]:
    """Return the numbers of a line of statistics by name, such as `heater_bed.temp`."""
    group, values = "", dict[str, float]()
    for word in text.split():
        if word.endswith(":"):
            group = word[:-1]
            continue
        name, _, value = word.partition("=")
        if _VALUE.match(value):
            of_all = not group or name in _OF_ALL
            values[name if of_all else f"{group}.{name}"] = float(value)
    return values
