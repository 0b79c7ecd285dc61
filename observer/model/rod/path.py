"""The path of a nut between the samples of its position: how far it ran, and where it turned.

A nut runs to and fro. Speed times lead says how far it can have gone since the last sample; where that is not
known, what it made lately does. Where samples are close together the path is the line through them. Where
they are sparse, a step shorter than the way it ran holds a reversal, and the missing distance says where.
Where a sample comes late, the nut is taken to have run on between the places where it turned last.

Nothing here divides by a time that may be an accident of delivery: two samples a microsecond apart say where
the nut is and nothing of how fast it runs.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from observer.frames import FloatArray, NutPath
from observer.kernels import follow_path
from observer.kernels.path import _DRIVEN, _FAR, _HERE, _HIGH, _LOW, _MADE, RECENT

_UNKNOWN = np.zeros(_MADE - 1 + RECENT)
_UNKNOWN[[_HERE - 1, _LOW - 1, _HIGH - 1, _DRIVEN - 1, _FAR - 1]] = np.nan


@dataclass(frozen=True, slots=True)
class PathState:
    """What is remembered of a nut's motion: the time of the last sample, and `rest` (25,).

    That is: its place; velocity over the step to it, 0 unless that was at full speed; speed; the places where
    it turned last, the lower and the higher, NaN while not known; speed times lead at the last sample, NaN
    where unknown; the sense in which it runs and the farthest place it has come to in it; how many steps were
    made, and the speeds of the last 16 of them.
    """

    time_s: float = np.nan
    rest: FloatArray = field(default_factory=lambda: _UNKNOWN)

    @property
    def scalars(self) -> FloatArray:
        """The state as compiled code takes it, (26,), to be changed in place."""
        scalars = np.empty(_MADE + RECENT)
        scalars[0], scalars[1:] = self.time_s, self.rest
        return scalars

    @classmethod
    def of(cls, scalars: FloatArray) -> PathState:
        """The state from what compiled code left, (26,)."""
        return cls(float(scalars[0]), scalars[1:])


def reversals(state: PathState, path: NutPath, stroke_m: float) -> tuple[PathState, FloatArray]:
    """Return the state after K steps, and after each the places (K, 2) where the nut turned last.

    They are NaN before they are known.
    """
    scalars = state.scalars
    ends_m = np.empty((len(path.offset) - 1, 2))
    follow_path(scalars, *path, stroke_m, ends_m)
    return PathState.of(scalars), ends_m
