"""Machines beside each other: whose heats are large for their speed."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass

import numpy as np

NEAR = 0.2
"""Speeds within this part of each other are compared; beyond, friction depends on speed in its own way."""
LEAST_OTHERS = 3
HOT_SHARE = 0.2
HOT_DEVIATIONS = 3.0
LEAST_GOOD = 0.5
"""The least share of a log's estimates that are good for its mean heats to stand as firmly as any."""
_NORMAL_MAD = 1.4826  # of a normal distribution: its standard deviation over its median absolute deviation


@dataclass(frozen=True, slots=True)
class MeanHeat:
    """The mean heat of one source in one log, at a mean speed, of a machine of some type.

    `good` is the share of the log's estimates that were good, NaN where no replay says it.
    """

    machine: str
    type: str
    source: str
    speed_rpm: float
    heat_W: float
    good: float = math.nan


@dataclass(frozen=True, slots=True)
class Beside(MeanHeat):
    """The heat of a machine's source beside that of its like: `usual_W` at the same speed.

    `usual_W` is None where fewer than three other machines run at about that speed.
    """

    usual_W: float | None = None
    others: int = 0
    hot: bool = False

    @property
    def doubtful(self) -> bool:
        """Whether so few of the estimates behind it were good that the heat is hardly known."""
        return self.good < LEAST_GOOD


def beside_fleet(heats: Sequence[MeanHeat]) -> list[Beside]:
    """Compare each machine's sources with the median of other machines of its type, at about its speed.

    A machine counts once for each source, by the medians of its logs. Heats are compared per rpm, which takes
    out what is left of the difference in speed; a source is hot where it is above the median by a fifth, and
    by three standard deviations as the median absolute deviation gives them.
    """
    own: dict[tuple[str, str, str], list[MeanHeat]] = {}
    for heat in heats:
        own.setdefault((heat.type, heat.source, heat.machine), []).append(heat)
    points = [
        MeanHeat(
            machine, kind, source, _median(h.speed_rpm for h in each), _median(h.heat_W for h in each),
            min((h.good for h in each if not math.isnan(h.good)), default=math.nan),
        )
        for (kind, source, machine), each in sorted(own.items())
    ]  # fmt: skip
    return [_beside(point, points) for point in points]


def _median(values: Iterable[float]) -> float:
    return float(np.median(list(values)))


def _beside(point: MeanHeat, points: Sequence[MeanHeat]) -> Beside:
    others = [
        other.heat_W / other.speed_rpm
        for other in points
        if (other.type, other.source) == (point.type, point.source)
        and other.machine != point.machine
        and other.speed_rpm > 0
        and abs(other.speed_rpm - point.speed_rpm) <= NEAR * max(other.speed_rpm, point.speed_rpm)
    ]
    usual_W, hot = None, False
    if len(others) >= LEAST_OTHERS:
        median = float(np.median(others))
        spread = _NORMAL_MAD * float(np.median(np.abs(np.array(others) - median)))
        usual_W = median * point.speed_rpm
        allowed_W = max(HOT_SHARE * abs(usual_W), HOT_DEVIATIONS * spread * point.speed_rpm)
        hot = point.heat_W - usual_W > allowed_W
    return Beside(**asdict(point), usual_W=usual_W, others=len(others), hot=hot)
