"""Logs whose rows are too far apart to show where a nut was.

At least `SAMPLES_PER_TRAVERSE` rows are needed to show a nut's path. With two, as under a stroboscope, the
same rows fit many paths: a nut that stands still at either end, creeps, or runs any number of times to and
fro. The distribution of its heat is then a guess, so no effect of the nut is searched for in such a log.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from observer.config.machine import Config
from observer.config.sections import Source
from observer.discovery.candidates import Candidate
from observer.discovery.log_faults import FaultKind
from observer.discovery.suspects import Suspect
from observer.fit.runs import FEWEST, LEAST_LEAD_M, Run, stretches_of_a_speed
from observer.frames import FloatArray
from observer.kernels.path import SAMPLES_PER_TRAVERSE

NUTS_WAY: FaultKind = "nut's way"
LASTS_S = 180.0
"""A speed counts if it lasts so long."""


class Sparse(NamedTuple):
    """A log that shows too few positions of a nut.

    Attributes:
        run: Number of the log, from 0.
        source: The moving source.
        positions: Positions shown in a traverse.
        row_s: Interval of the rows, s.
    """

    run: int
    source: Source
    positions: float
    row_s: float


def sparse_paths(config: Config, runs: Sequence[Run]) -> tuple[Suspect, ...]:
    """Return a suspect for each moving source whose path the rows of some log do not show.

    Sources without a position or a speed channel are not judged.

    Args:
        config: The machine.
        runs: The prepared logs.
    """
    sparse = [s for i, run in enumerate(runs) for s in _sparse(config, i, run)]
    worst = {s.source.name: s for s in sorted(sparse, key=lambda s: -s.positions)}
    return tuple(_described(s) for s in worst.values())


def needs_path(candidate: Candidate, config: Config) -> bool:
    """Return whether an effect can only be found if the paths of nuts are known.

    This is so for an effect of a moving source, and for one that is found by its position under a nut.
    """
    moving = {s.name for s in config.source if s.position_channel is not None}
    placed = bool({"position_m", "from_m"} & set(candidate.fitted))
    return bool(moving) and (candidate.of.on_the_way or candidate.target in moving or placed)


def _sparse(config: Config, number: int, run: Run) -> Iterator[Sparse]:
    frames = run.frames
    for source in config.source:
        if source.position_channel is None or source.speed_channel is None or len(frames) <= FEWEST:
            continue
        place_m = frames.values[:, frames.channels.index(source.position_channel)]
        speed_rpm = np.abs(np.nan_to_num(frames.values[:, frames.channels.index(source.speed_channel)]))
        row_s, stroke_m = float(np.median(frames.dt_s[1:])), float(np.nanmax(place_m) - np.nanmin(place_m))
        per_row_m = speed_rpm / 60.0 * (source.lead_m or LEAST_LEAD_M) * row_s
        shown = [
            positions_a_traverse(place_m[part], float(np.median(per_row_m[part])), stroke_m)
            for part in stretches_of_a_speed(speed_rpm)
            if len(part) * row_s >= LASTS_S
        ]
        if min(shown, default=np.inf) < SAMPLES_PER_TRAVERSE:
            yield Sparse(number, source, min(shown), row_s)


def positions_a_traverse(place_m: FloatArray, per_row_m: float, stroke_m: float) -> float:
    """Return how many rows a traverse has, infinite while the nut rests.

    The number of turns is a second measure. If the nut runs farther than to the other end between two rows,
    it seems to turn at almost every row.

    Args:
        place_m: Places of the nut in consecutive rows at one speed, m, (K,).
        per_row_m: Least way from row to row, m.
        stroke_m: Largest possible stroke, m.
    """
    place_m = place_m[np.isfinite(place_m)]
    if len(place_m) <= FEWEST or np.ptp(place_m) == 0.0:
        return np.inf
    steps_m = np.diff(place_m)
    senses = np.sign(steps_m[steps_m != 0.0])
    turns = np.count_nonzero(np.diff(senses))
    by_turns = len(senses) / turns if turns >= FEWEST else np.inf
    by_way = stroke_m / per_row_m if per_row_m > 0.0 else np.inf
    return min(by_turns, by_way)


def _described(sparse: Sparse) -> Suspect:
    """Return the suspect for a nut whose path a log does not show."""
    source, most_s = sparse.source, sparse.row_s * sparse.positions / SAMPLES_PER_TRAVERSE
    last_digit_s = 10.0 ** (math.floor(math.log10(most_s)) - 1)
    most_s = math.floor(most_s / last_digit_s) * last_digit_s
    text = (
        f"Log {sparse.run + 1} shows {_below(sparse.positions)} positions of {source.name} a traverse, and "
        f"{SAMPLES_PER_TRAVERSE:g} are needed to show its way, so no effect of it, or under it, is looked "
        f"for; log {source.position_channel} every {most_s:.2g} s or more often"
    )
    return Suspect(NUTS_WAY, source.position_channel, _below(sparse.positions), text)


def _below(positions: float) -> float:
    """Return the positions in a traverse, with as few digits as show that they are fewer than needed."""
    return next(
        rounded for digits in range(1, 17) if (rounded := round(positions, digits)) < SAMPLES_PER_TRAVERSE
    )
