"""The screw at one temperature everywhere, and what its ends and the air do to it from then on.

In the plant the dropped modes follow known inputs at once, which is right for what changes slowly. At the
start it is not: an end at another temperature than the screw would act along the whole screw in no time. So
what the plant's outputs lack for a while is added from a screw of many modes.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from observer.config import Config
from observer.frames import FloatArray
from observer.model.build import with_many_modes
from observer.model.plant import Plant
from observer.model.rod.modes import held_s
from observer.model.simulate import start

_NEGLIGIBLE = 1e-6
"""K or µm of an output row below which a step of the known inputs needs no addition."""
_SETTLED = 30.0
"""Times the slowest dropped mode's time constant after which nothing is lacking: e⁻³⁰."""


class Response(NamedTuple):
    """How rows respond to a step that known inputs make: states (n,) that it `drives` at `decay_1_s`, rows
    `C` (R, n) of them, and what the rows (R,) show `at_once`.
    """

    decay_1_s: FloatArray
    drives: FloatArray
    C: FloatArray
    at_once: FloatArray

    @classmethod
    def of(cls, plant: Plant, step_K: FloatArray) -> Response:
        """That of a plant to a step (p,) of its known inputs."""
        return cls(plant.decay_1_s, plant.E @ step_K, plant.rows.C, plant.rows.F @ step_K)

    def after(self, time_s: FloatArray) -> FloatArray:
        """The rows (K, R) some times (K,) after the step."""
        return held_s(self.decay_1_s, time_s[:, None]) * self.drives @ self.C.T + self.at_once


class Beginning(NamedTuple):
    """The state `x` of the start, its output rows (R,), and what the known inputs do from `begin_s` on, by
    the plant and by `reference` modes, None where the two are the same.
    """

    x: FloatArray
    rows: FloatArray
    begin_s: float
    reduced: Response
    reference: Response | None
    lasts_s: float

    def add_to(self, rows: FloatArray, time_s: FloatArray) -> None:
        """Put the start itself, and what the plant lacks after it, into output rows (K, R) at times (K,)."""
        after_s = time_s - self.begin_s
        rows[after_s <= 0.0] = self.rows
        lacking = np.flatnonzero((after_s > 0.0) & (after_s < self.lasts_s))
        if self.reference is not None and len(lacking):
            rows[lacking] += self.reference.after(after_s[lacking]) - self.reduced.after(after_s[lacking])


def beginning(
    plant: Plant, config: Config | None, temperature_degC: float, z: FloatArray, begin_s: float
) -> Beginning:
    """Return the start of a screw at one temperature, its lags empty: no heat has acted yet.

    `z` (p,) are the known inputs from `begin_s` on; until then ends and air were at the screw's temperature.
    Without a configuration nothing is added to what the plant itself makes of the step.
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
