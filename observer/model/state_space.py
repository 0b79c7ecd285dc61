"""The plant as a `control.StateSpace`."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from observer.model.generator import generator
from observer.model.plant import Plant

if TYPE_CHECKING:
    import control


def state_space(plant: Plant) -> control.StateSpace:
    """Return the plant with fixed footprints as a continuous-time system.

    Inputs are the heats in W and the known inputs, outputs the rows in °C and µm; a moving nut is spread
    over its stroke, and losses that change with speed or temperature are left out. For design and study with
    python-control; the estimators step the plant by their own exact formulas.
    """
    import control  # noqa: PLC0415  (takes two seconds: only who asks for it pays)

    rows, first = plant.rows, plant.lag_slice.stop
    sources = [name.replace(".", "_") for name in plant.source_names]  # control allows no dot in a name
    return control.ss(
        generator(plant),
        np.hstack([plant.B, plant.E]),
        rows.C,
        np.hstack([np.zeros((len(rows.C), len(plant.source_names))), rows.F]),
        states=[
            *(f"mode {n}" for n in plant.mode_index),
            *(f"lag {name}" for name in sources),
            *(f"beside {i + 1}" for i in range(len(plant.decay_1_s) - first)),
        ],
        inputs=[*sources, *(name.replace(".", "_") for name in plant.known_names)],
        outputs=[f"row {r}" for r in range(len(rows.C))],
    )
