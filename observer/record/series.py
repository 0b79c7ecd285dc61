"""One value of the estimates over time, for OPC UA's history."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from observer.bus.exchange import KEYS, KeyFigure
from observer.frames import PARTS, EstimateBlock, EstimateQuality, Layout, Quality
from observer.record.step_store import Past

_QUALITY = [quality.label for quality in EstimateQuality]
_SENSOR = [quality.label for quality in Quality]
FIGURES = tuple(f for f in KEYS["estimate"].figures if f.node is not None and f.path != "position_m")
"""What has a history in OPC UA."""


class Series(NamedTuple):
    """Values of a node over time.

    Attributes:
        time_s: Times, s since 1970.
        values: Values; lists for arrays, words for qualities.
        quality: The quality of each value.
        next_s: The time of the value that follows; None at the end.
    """

    time_s: list[float]
    values: list[Any]
    quality: list[str]
    next_s: float | None


class _Column(NamedTuple):
    """A figure and which of its entries, None for all of them."""

    figure: KeyFigure
    entry: int | None


def has_history(node: tuple[str, ...]) -> bool:
    """Return whether a node has a recorded past.

    Args:
        node: Its path below the axis.
    """
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


def _values(column: _Column, block: EstimateBlock) -> tuple[Any, list[str]]:
    """Return the values of a block, and the quality of each."""
    part = column.figure.part
    codes = block.part_quality[:, PARTS.index(part)] if part else block.quality
    quality = [_QUALITY[code] for code in codes]
    values = getattr(block, column.figure.path)
    if column.entry is None:
        return values, quality
    values = values[:, column.entry]
    if column.figure.used is not None:
        used = block.sensor_quality[:, column.entry] == Quality.GOOD
        quality = [q if good else "invalid" for q, good in zip(quality, used, strict=True)]
    return values, quality


def series(
    past: Past, node: tuple[str, ...], from_s: float, to_s: float, most: int, *, backwards: bool
) -> Series:
    """Return the first `most` values of a span.

    A sensor's value is invalid at steps that did not use the sensor. Files whose configuration lacks the node
    are left out.

    Args:
        past: The published steps.
        node: Path of a node that `has_history`.
        from_s: First time.
        to_s: End, itself excluded.
        most: Largest number of values.
        backwards: Return the last values instead, in reverse order.
    """
    times_s: list[float] = []
    values: list[Any] = []
    quality: list[str] = []
    for steps in past.read(from_s, to_s, [], backwards=backwards):
        column = _column(node, steps.source.layout)
        if column is None:
            continue
        column_values, qualities = _values(column, steps.estimates)
        turn = slice(None, None, -1 if backwards else 1)
        times_s += steps.time_s[turn].tolist()
        values += (
            [_SENSOR[code] for code in column_values]
            if column_values.dtype == np.int8
            else column_values.tolist()
        )[turn]
        quality += qualities[turn]
        if len(times_s) > most:
            break
    next_s = None if len(times_s) <= most else times_s[most]
    return Series(times_s[:most], values[:most], quality[:most], next_s)
