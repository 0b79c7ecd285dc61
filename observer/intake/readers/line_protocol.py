"""Line protocol of InfluxDB: measurement and tags, fields, and a time since 1970."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pyarrow as pa

from observer.intake.sheets import RawColumn, Sheet

_LINE = re.compile(
    r"^(?P<series>(?:\\.|[^\s\\])+) (?P<fields>(?:\"(?:\\.|[^\"\\])*\"|\\.|[^\s\\\"])+) (?P<time>\d{9,19})$"
)
_FIELD = re.compile(r"((?:\\.|[^,=\\])+)=(\"(?:\\.|[^\"\\])*\"|[^,]*)")
_CHECKED = 20


def recognises(text: str) -> bool:
    """Return whether a text is line protocol with a time in each line; lines that begin with `#` are
    comments.

    The first 20 lines decide.
    """
    lines = [line for line in text[:20_000].split("\n") if line.strip() and not line.startswith("#")]
    lines = lines[:_CHECKED]
    return bool(lines) and all(_LINE.match(line) and "=" in line for line in lines[:-1] or lines)


def read(path: Path, text: str) -> list[Sheet]:
    """Read a text as one sheet with one value in a row: `time`, `name`, `value`.

    Measurement, tags and field form the name of the signal, joined by points. Lines without a time are left
    out, which is a doubt.
    """
    times, names, values, lines, unread_lines = [], [], [], [], []
    for number, line in enumerate(text.split("\n"), 1):
        if not line.strip() or line.startswith("#"):
            continue
        match = _LINE.match(line)
        if match is None:
            unread_lines.append(number)
            continue
        measurement, *tags = re.split(r"(?<!\\),", match["series"])
        of_tags = [tag.partition("=")[2] for tag in tags]
        for field, value in _FIELD.findall(match["fields"]):
            times.append(float(match["time"]))
            names.append(".".join([measurement, *of_tags, *([field] if field != "value" else [])]))
            values.append(value.strip('"').removesuffix("i").removesuffix("u"))
            lines.append(number)
    doubts = (
        [f"{len(unread_lines)} lines have no time and were left out, the first is line {unread_lines[0]}"]
        if unread_lines
        else []
    )
    columns = (
        RawColumn("time", np.array(times)),
        RawColumn("name", pa.array(names, pa.string())),
        RawColumn("value", pa.array(values, pa.string())),
    )
    return [Sheet(path, "", columns, lines=np.array(lines, np.int64), doubts=tuple(doubts))]
