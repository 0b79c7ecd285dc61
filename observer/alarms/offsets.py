"""What a sensor's learnt offset usually is, and whether it has moved: how an ageing sensor shows.

An observer that learns offsets follows a sensor that drifts, so that nothing disagrees; what moves is the
offset. It is averaged over its first hours of good estimates and kept as it is from then on; what it is now,
smoothed over some hours, is held against that. At rest, when all of the screw has one temperature, an offset
is known best.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

SMOOTH_H = 4.0
"""What an offset is now is smoothed over so many hours of good estimates."""
CLEAR = 0.6
"""The part of the limit below which a sensor has not moved any more."""
_SURE = 1 / 3
"""An offset whose σ exceeds this part of the limit is not judged."""


class KnownOffset(NamedTuple):
    """What is known of a sensor's offset after `hours` of it: what it usually is, what it is now."""

    hours: float = 0.0
    usual_K: float = 0.0
    now_K: float = 0.0
    moved: bool = False


def taken(
    known: KnownOffset, offset_K: float, sigma_K: float, hours: float, learn_h: float, limit_K: float
) -> KnownOffset:
    """Return what is known after `hours` more of an estimated offset; an uncertain one is ignored."""
    if not sigma_K < _SURE * limit_K:
        return known
    total_h = known.hours + hours
    usual_K = known.usual_K
    if known.hours < learn_h:
        usual_K += hours / total_h * (offset_K - usual_K)
    now_K = known.now_K + hours / min(total_h, SMOOTH_H) * (offset_K - known.now_K)
    limit_K *= CLEAR if known.moved else 1.0
    return KnownOffset(total_h, usual_K, now_K, total_h > learn_h and abs(now_K - usual_K) > limit_K)


def offset_of(plain: Mapping[str, Any]) -> KnownOffset:
    """An offset from plain data; raises `ValueError`, `KeyError` or `TypeError` where it is none."""
    hours, usual_K, now_K = (float(plain[key]) for key in ("hours", "usual_K", "now_K"))
    if not math.isfinite(hours + usual_K + now_K):
        raise ValueError("an offset is no number")
    return KnownOffset(hours, usual_K, now_K, bool(plain["moved"]))
