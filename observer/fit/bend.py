"""Readings of displacement sensors where a support has play: they are not linear in the temperatures.

The screw is predicted as if it grew freely, with one more sensor that reads its whole growth. The growth that
the supports hold back is subtracted afterwards (`observer.model.rod.supports`).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from observer.config.machine import Config
from observer.frames import FloatArray
from observer.model.rod.supports import Restraint, restraint_of, taken_off_um
from observer.model.simulate import Means

_WHOLE = "screw.growth"


class Bend(NamedTuple):
    """Supports with play, applied to the predictions of a free screw.

    Attributes:
        moved: Numbers of the displacement sensors, (d,).
        restraint: The supports, with the part of the growth that they hold back at the sensors' positions.
    """

    moved: tuple[int, ...]
    restraint: Restraint

    def of(self, values: Means) -> Means:
        """Return the rows of the sensors between supports.

        Args:
            values: Rows of a free screw, (T, s + 1), the last one its whole growth, µm.

        Returns:
            Rows (T, s), of which displacements are reduced by the held-back growth, µm.
        """
        ends = self._restrained(values.ends)
        way = ends - self._restrained(values.ends - values.way)
        return Means(ends, self._restrained(values.means), way, values.passed_W)

    def _restrained(self, rows: FloatArray) -> FloatArray:
        out, growth_um = rows[:, :-1].copy(), rows[:, -1:]
        out[:, list(self.moved)] -= taken_off_um(self.restraint, growth_um)
        return out


def unbent(config: Config) -> tuple[Config, Bend | None]:
    """Return the configuration of a free screw with one more sensor, and the supports to apply afterwards.

    Args:
        config: The machine.

    Returns:
        The configuration without supports and with a sensor of the whole growth, and the `Bend`. The
        configuration unchanged and None if it has no displacement sensor or no play.
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
