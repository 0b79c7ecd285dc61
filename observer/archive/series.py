"""One value of the estimates over time, for OPC UA's history."""

from __future__ import annotations

import math
import time
from typing import Any, NamedTuple

import cbor2
import numpy as np

from observer.archive.pages import Span
from observer.archive.store import Archive, Chapter
from observer.exchange import KEYS, KeyFigure
from observer.frames import PARTS, EstimateQuality, Layout, Quality

_STEP_S = 3600.0
_WITHIN_S = 6.0
_QUALITY = [quality.label for quality in EstimateQuality]
_SENSOR = [quality.label for quality in Quality]
FIGURES = tuple(f for f in KEYS["estimate"].figures if f.node is not None and f.path != "position_m")
"""What has a history in OPC UA."""


class _Column(NamedTuple):
    """A figure and which of its entries, None for all of them."""

    figure: KeyFigure
    entry: int | None


def has_history(node: tuple[str, ...]) -> bool:
    """Whether a node, by its path below the axis, has a recorded past."""
    return any(_fits(figure, node) for figure in FIGURES)


def _fits(figure: KeyFigure, node: tuple[str, ...]) -> bool:
    parts = (figure.node or "").split("/")
    return len(parts) == len(node) and all(p in ("{}", n) for p, n in zip(parts, node, strict=True))


def _column(node: tuple[str, ...], layout: Layout) -> _Column | None:
    """Where a node's values are in the estimates of a layout; None where that has none."""
    figure = next(figure for figure in FIGURES if _fits(figure, node))
    parts = (figure.node or "").split("/")
    if "{}" not in parts:
        return _Column(figure, None)
    names = layout.sources if figure.by == "sources" else layout.sensors
    name = node[parts.index("{}")]
    return _Column(figure, names.index(name)) if name in names else None


def _values(column: _Column, chapter: Chapter) -> tuple[Any, list[str]]:
    """The values of the wanted steps of a chapter, and the quality of each."""
    block, here = chapter.estimates, chapter.wanted
    assert block is not None
    part = column.figure.part
    codes = block.part_quality[:, PARTS.index(part)] if part else block.quality
    quality = [_QUALITY[code] for code in codes[here]]
    values = getattr(block, column.figure.path)[here]
    if column.entry is None:
        return values, quality
    values = values[:, column.entry]
    if column.figure.used is not None:
        used = block.sensor_quality[here, column.entry] == Quality.GOOD
        quality = [q if good else "invalid" for q, good in zip(quality, used, strict=True)]
    return values, quality


def series(archive: Archive, node: list[str], span: Span, most: int, *, backwards: bool) -> bytes:
    """The first `most` values of a span, the last ones in reverse order if `backwards`, as CBOR.

    `{"time_s", "values", "quality", "next"}`; `next` is the time of the value that follows, None at the end.
    """
    until_s, at_s = time.monotonic() + _WITHIN_S, (span.to_s if backwards else span.from_s)
    times: list[float] = []
    values: list[Any] = []
    quality: list[str] = []
    while len(times) <= most and (at_s > span.from_s if backwards else at_s < span.to_s):
        begin_s = max(span.from_s, at_s - _STEP_S) if backwards else at_s
        end_s = at_s if backwards else min(span.to_s, at_s + _STEP_S)
        begin_s, end_s, at_s = _skipped(archive, begin_s, end_s, span, backwards=backwards)
        found = _taken(archive, tuple(node), begin_s, end_s, until_s)
        turn = slice(None, None, -1 if backwards else 1)
        times += found[0][turn]
        values += found[1][turn]
        quality += found[2][turn]
    next_s = None if len(times) <= most else times[most]
    return cbor2.dumps(
        {"time_s": times[:most], "values": values[:most], "quality": quality[:most], "next": next_s}
    )


def _skipped(
    archive: Archive, begin_s: float, end_s: float, span: Span, *, backwards: bool
) -> tuple[float, float, float]:
    """A stretch, moved over a time in which nothing was recorded, and where the next one begins."""
    files = archive.files()
    if backwards:
        reach = max((f.to_s for f in files if f.from_s < end_s), default=-math.inf)
        if reach < begin_s:
            end_s = max(span.from_s, math.nextafter(reach, math.inf))
            begin_s = max(span.from_s, end_s - _STEP_S)
        return begin_s, end_s, begin_s
    reach = min((f.from_s for f in files if f.to_s >= begin_s), default=math.inf)
    if reach > end_s:
        begin_s = min(span.to_s, reach)
        end_s = min(span.to_s, begin_s + _STEP_S)
    return begin_s, end_s, end_s


def _taken(
    archive: Archive, node: tuple[str, ...], begin_s: float, end_s: float, until_s: float
) -> tuple[list[float], list[Any], list[str]]:
    """Times, values and qualities of a stretch; of NaN, which is no value, the quality is invalid."""
    times: list[float] = []
    values: list[Any] = []
    quality: list[str] = []
    for chapter in archive.read(begin_s, end_s, [], until_s=until_s):
        column = _column(node, archive.setup(chapter.origin.used).layout)
        if column is None:
            continue
        found, own = _values(column, chapter)
        times += chapter.frames.time_s[chapter.wanted].tolist()
        values += [_SENSOR[code] for code in found] if found.dtype == np.int8 else found.tolist()
        quality += own
    return times, values, quality
