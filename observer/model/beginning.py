"""The start of a screw at one temperature, and its first response to ends and air.

In the plant, dropped modes follow the known inputs at once. That is right for slow changes and wrong at the
start. An end at another temperature would act along the whole screw immediately. `Beginning` adds the
difference to the response of a plant with many modes.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from observer.config.machine import Config
from observer.frames import FloatArray
from observer.model.build import with_many_modes
from observer.model.plant import Plant
from observer.model.rod.modes import held_s
from observer.model.simulate import start

_NEGLIGIBLE = 1e-6
"""K or µm of an output row below which both responses count as equal."""
_SETTLED = 30.0
"""Time constants of the slowest dropped mode until both responses agree: e⁻³⁰."""


class Response(NamedTuple):
    """The response of output rows to a step of the known inputs.

    Attributes:
        decay_1_s: Decay rates of the states, (n,).
        drives: Rates at which the step drives the states, (n,).
        C: Output rows of the states, (R, n).
        at_once: Immediate change of the rows, (R,).
    """

    decay_1_s: FloatArray
    drives: FloatArray
    C: FloatArray
    at_once: FloatArray

    @classmethod
    def of(cls, plant: Plant, step_K: FloatArray) -> Response:
        """Return the response of a plant to a step of its known inputs.

        Args:
            plant: The model.
            step_K: Change of each known input, K, (p,).
        """
        return cls(plant.decay_1_s, plant.E @ step_K, plant.rows.C, plant.rows.F @ step_K)

    def after(self, time_s: FloatArray) -> FloatArray:
        """Return the rows at times after the step, °C or µm beyond those before it, (K, R).

        Args:
            time_s: Times since the step, s, (K,).
        """
        return held_s(self.decay_1_s, time_s[:, None]) * self.drives @ self.C.T + self.at_once


class Beginning(NamedTuple):
    """The start of a simulation.

    Attributes:
        x: The state at the start.
        rows: Its output rows, (R,).
        begin_s: The time at which the known inputs begin to act.
        reduced: The response of the plant.
        reference: The response of a plant with many modes; None if both are equal.
        lasts_s: The time after which both responses agree.
    """

    x: FloatArray
    rows: FloatArray
    begin_s: float
    reduced: Response
    reference: Response | None
    lasts_s: float

    def add_to(self, rows: FloatArray, time_s: FloatArray) -> None:
        """Write the start into output rows, and add the difference of both responses.

        Rows up to `begin_s` become those of the start. Later ones are corrected for `lasts_s`.

        Args:
            rows: Output rows of a simulation with the reduced plant, (K, R), changed in place.
            time_s: Their times, s, (K,).
        """
        after_s = time_s - self.begin_s
        rows[after_s <= 0.0] = self.rows
        lacking = np.flatnonzero((after_s > 0.0) & (after_s < self.lasts_s))
        if self.reference is not None and len(lacking):
            rows[lacking] += self.reference.after(after_s[lacking]) - self.reduced.after(after_s[lacking])


def beginning(
    plant: Plant, config: Config | None, temperature_degC: float, z: FloatArray, begin_s: float
) -> Beginning:
    """Return the start of a screw at one temperature, its lags empty: no heat has acted yet.

    Args:
        plant: The model.
        config: Its configuration, for a plant with many modes. None makes no correction.
        temperature_degC: Temperature of the screw at the start, °C. Until `begin_s` ends and air have it too.
        z: Known inputs from `begin_s` on, (p,).
        begin_s: Time at which the known inputs begin to act, s.
    """
    columns = plant.known
    before = z.copy()
    acting = [i for i in (columns.ambient, columns.left_end, columns.right_end) if i is not None]
    before[acting] = temperature_degC
    x = start(plant, temperature_degC, np.zeros(len(plant.source_names)))
    reduced = Response.of(plant, z - before)
    reference = None
    if config is not None and np.abs(reduced.at_once).max() > _NEGLIGIBLE:
        reference = Response.of(with_many_modes(config), z - before)
    rows = plant.rows.C @ x + plant.rows.F @ before
    return Beginning(x, rows, begin_s, reduced, reference, _SETTLED / plant.dropped_rate_1_s)
