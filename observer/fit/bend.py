"""Readings of displacement sensors where a support has play: not linear in the temperatures.

The screw is predicted as if it grew freely, with one sensor more, of the growth of all of it; what the
supports hold back of that is taken off afterwards (`observer.model.rod.supports`).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from observer.config import Config
from observer.frames import FloatArray
from observer.model.rod.supports import Restraint, restraint_of, taken_off_um
from observer.model.simulate import Means

_WHOLE = "screw.growth"


class Bend(NamedTuple):
    """The displacement sensors (d,), and the supports that restrain the screw at their positions."""

    moved: tuple[int, ...]
    restraint: Restraint

    def of(self, values: Means) -> Means:
        """Return the rows (T, s) from those of a free screw (T, s + 1), the last its whole growth."""
        ends = self._restrained(values.ends)
        way = ends - self._restrained(values.ends - values.way)
        return Means(ends, self._restrained(values.means), way, values.passed_W)

    def _restrained(self, rows: FloatArray) -> FloatArray:
        out, growth_um = rows[:, :-1].copy(), rows[:, -1:]
        out[:, list(self.moved)] -= taken_off_um(self.restraint, growth_um)
        return out


def unbent(config: Config) -> tuple[Config, Bend | None]:
    """Return the configuration of a free screw with a sensor of its growth, and what bends that; as it is,
    and None, where no displacement sensor or no play is.
    """
    moved = tuple(i for i, s in enumerate(config.sensor) if s.kind == "displacement")
    if not moved or config.supports is None or config.supports.gap_m == 0.0:
        return config, None
    screw = config.screw
    places_m = np.array([config.sensor[i].position_m or 0.0 for i in moved])
    restraint = restraint_of(config.supports, screw, places_m)
    whole = config.sensor[moved[0]].model_copy(update={"name": _WHOLE, "position_m": screw.length_m})
    free = config.model_copy(update={"supports": None, "sensor": (*config.sensor, whole)})
    return free, Bend(moved, restraint)
