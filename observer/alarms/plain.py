"""Bands, offsets and alarms as plain data that a file keeps, and back from it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from observer.alarms.bands import Band, nothing_known
from observer.alarms.kinds import KINDS
from observer.alarms.offsets import Offset
from observer.alarms.states import Alarm, Condition


def of_band(band: Band) -> dict[str, Any]:
    """Return a band as lists and numbers."""
    plain = band._asdict()
    lists = {key: value.tolist() for key, value in plain.items() if isinstance(value, np.ndarray)}
    return plain | lists | {"at_s": None if math.isnan(band.at_s) else band.at_s}


def band(plain: Mapping[str, Any]) -> Band:
    """A band from what was kept; raises `ValueError`, `KeyError` or `TypeError` where it is none."""
    values: dict[str, Any] = {}
    for key, like in nothing_known()._asdict().items():
        value = math.nan if key == "at_s" and plain[key] is None else plain[key]
        if isinstance(like, np.ndarray):
            values[key] = np.asarray(value, float)
            if values[key].shape != like.shape or not np.isfinite(values[key]).all():
                raise ValueError(f"{key} does not fit")
        else:
            values[key] = type(like)(value)
    return Band(**values)


def offset(plain: Mapping[str, Any]) -> Offset:
    """Return an offset from what was kept; raises as `band` does."""
    hours, usual_K, now_K = (float(plain[key]) for key in ("hours", "usual_K", "now_K"))
    if not math.isfinite(hours + usual_K + now_K):
        raise ValueError("an offset is no number")
    return Offset(hours, usual_K, now_K, bool(plain["moved"]))


def alarm(plain: Mapping[str, Any]) -> Alarm:
    """Return an alarm from what was kept; raises as `band` does."""
    condition = Condition(**plain["condition"])
    if condition.kind not in KINDS:
        raise ValueError(f"kind {condition.kind}")
    return Alarm(plain["state"], float(plain["since_s"]), float(plain["seen_s"]), condition)
