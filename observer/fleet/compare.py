"""Machines beside each other: whose heats are large for their speed, and whose parameters agree."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass

import numpy as np
from scipy.cluster.hierarchy import fcluster, linkage
from scipy.spatial.distance import squareform
from scipy.stats import chi2

from observer.frames import FloatArray

NEAR = 0.2
"""Speeds within this part of each other are compared; beyond, friction depends on speed in its own way."""
LEAST_OTHERS = 3
HOT_SHARE = 0.2
HOT_DEVIATIONS = 3.0
LEAST_GOOD = 0.5
"""The least share of a log's estimates that are good for its mean heats to stand as firmly as any."""
_NORMAL_MAD = 1.4826  # of a normal distribution: its standard deviation over its median absolute deviation
_NORMAL_95 = 1.959964
_LEVEL = 0.05


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


def _median(values: object) -> float:
    return float(np.median(list(values)))  # type: ignore[call-overload]


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


@dataclass(frozen=True, slots=True)
class Calibrated:
    """What was calibrated of a machine: each key's value and the ends of its 95 % interval."""

    machine: str
    type: str
    values: Mapping[str, tuple[float, float, float]]


@dataclass(frozen=True, slots=True)
class Shared:
    """Machines that one configuration could describe, with the values to share and their 95 % ends."""

    machines: tuple[str, ...]
    type: str
    values: Mapping[str, tuple[float, float, float]]


def groups(machines: Sequence[Calibrated]) -> list[Shared]:
    """Group machines of a type and of the same calibrated keys whose values agree within their intervals.

    Two agree where χ² = Σ (a − b)² / (σ_a² + σ_b²) over the keys stays below its 95 % quantile, Bonferroni's
    for all pairs of the type; within a group each agrees with each (complete linkage). The shared values are
    means weighted by 1/σ². The largest groups come first.
    """
    likes: dict[tuple[str, tuple[str, ...]], list[Calibrated]] = {}
    for known in sorted(machines, key=lambda known: known.machine):
        likes.setdefault((known.type, tuple(sorted(known.values))), []).append(known)
    found = [
        _shared(part, kind, keys) for (kind, keys), own in likes.items() if keys for part in _parts(own, keys)
    ]
    return sorted(found, key=lambda shared: (-len(shared.machines), shared.machines))


def _parts(own: Sequence[Calibrated], keys: Sequence[str]) -> list[list[Calibrated]]:
    if len(own) == 1:
        return [list(own)]
    x, sigma = _table(own, keys)
    pairs = list(itertools.combinations(range(len(own)), 2))
    apart = np.array([np.sum((x[i] - x[j]) ** 2 / (sigma[i] ** 2 + sigma[j] ** 2)) for i, j in pairs])
    limit = float(chi2.ppf(1.0 - _LEVEL / len(pairs), len(keys)))
    labels = fcluster(linkage(squareform(squareform(apart)), "complete"), limit, "distance").tolist()
    return [
        [known for known, own_label in zip(own, labels, strict=True) if own_label == label]
        for label in sorted(set(labels))
    ]


def _table(own: Sequence[Calibrated], keys: Sequence[str]) -> tuple[FloatArray, FloatArray]:
    """Values and standard deviations (m, k); an interval without width counts as a millionth of its value."""
    x = np.array([[known.values[key][0] for key in keys] for known in own])
    half = np.array([[(known.values[key][2] - known.values[key][1]) / 2 for key in keys] for known in own])
    return x, np.maximum(half / _NORMAL_95, 1e-6 * np.abs(x) + 1e-12)


def _shared(part: Sequence[Calibrated], kind: str, keys: Sequence[str]) -> Shared:
    x, sigma = _table(part, keys)
    weight = 1.0 / sigma**2
    mean = (weight * x).sum(axis=0) / weight.sum(axis=0)
    half = _NORMAL_95 / np.sqrt(weight.sum(axis=0))
    ends = zip(keys, mean.tolist(), (mean - half).tolist(), (mean + half).tolist(), strict=True)
    return Shared(
        tuple(known.machine for known in part), kind, {key: (v, low, high) for key, v, low, high in ends}
    )
