"""Where and when a machine was last zeroed, and the thermal error since.

Homing on a switch, or a work offset that is probed, absorbs the error of that place and moment e(x₀, t₀) at
every position alike; what remains to be compensated is e(x, t) − e(x₀, t₀). Not the whole profile of
that moment becomes zero: the error between x₀ and the rest of the screw stays.

The correlation of the errors of two moments is unknown, so their uncertainties are added:
neither the standard deviation of a difference nor its bound exceeds the sum of both.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, NamedTuple

from observer.frames import EstimateBlock, FloatArray


@dataclass(frozen=True, slots=True)
class ZeroPoint:
    """When, where and by whom a machine was set to zero, and the error that this absorbed.

    Attributes:
        time_s: The time; NaN before the first zero, and nothing is subtracted then.
        at_m: The place on the screw, in m from its left end.
        error_um: The absorbed error along the screw, whatever the machine's own direction.
        sigma_um: Its standard deviation.
        bound_um: Its bound; NaN where that is not known.
        by: Who has zeroed the machine.
        missed: Whether it was set to zero again while the error was unknown; nothing can be compensated until
            it is set once more.
    """

    time_s: float = math.nan
    at_m: float = math.nan
    error_um: float = 0.0
    sigma_um: float = 0.0
    bound_um: float = 0.0
    by: str = ""
    missed: bool = False


NEVER = ZeroPoint()


class ErrorSince(NamedTuple):
    """The thermal error since a zero, along the screw, on the grid of g places.

    Attributes:
        error_um: The error, (g,).
        sigma_um: Its standard deviation, (g,).
        bound_um: Its bound, (g,); NaN where that is not known.
    """

    error_um: FloatArray
    sigma_um: FloatArray
    bound_um: FloatArray


def since(zero: ZeroPoint, block: EstimateBlock) -> ErrorSince:
    """Return the error of an estimate, a block of one, since a zero.

    σ and bound are the sums of both moments', since the correlation of their errors is unknown.
    """
    return ErrorSince(
        block.error_um[0] - zero.error_um,
        block.error_sigma_um[0] + zero.sigma_um,
        block.error_bound_um[0] + zero.bound_um,
    )


def zero_document(zero: ZeroPoint, direction: float, origin_m: float) -> dict[str, Any] | None:
    """Return a published zero, in the coordinates of the machine; None before the first zero.

    Args:
        zero: The zero.
        direction: The direction in which the machine counts, +1 or −1.
        origin_m: The machine's zero on the screw, in m.
    """
    if math.isnan(zero.time_s):
        return None
    return {
        "time_s": zero.time_s,
        "by": zero.by,
        "position_m": round(direction * (zero.at_m - origin_m), 9),
        "error_um": round(direction * zero.error_um, 6),
        "sigma_um": round(zero.sigma_um, 6),
        "bound_um": None if math.isnan(zero.bound_um) else round(zero.bound_um, 6),
    }
