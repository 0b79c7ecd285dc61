"""The plant as a `control.StateSpace`, and Kim's form of it with lifted end temperatures."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from observer.frames import FloatArray
from observer.model.plant import Plant
from observer.model.rod.modes import Modes
from observer.model.rod.static import Stretch, end_field, quadrature
from observer.model.rod.truncation import modal_input

if TYPE_CHECKING:
    import control


def state_space(plant: Plant) -> control.StateSpace:
    """Return the plant with fixed footprints as a continuous-time system.

    Inputs are the heats in W and the known inputs, outputs the rows in °C and µm; a moving nut is spread
    over its stroke. For design and study with python-control; the estimators step the plant by their own
    exact formulas.
    """
    import control  # noqa: PLC0415  (takes two seconds: only who asks for it pays)

    rows = plant.rows
    return control.ss(
        np.diag(-plant.decay_1_s),
        np.hstack([plant.B, plant.E]),
        rows.C,
        np.hstack([np.zeros((len(rows.C), len(plant.source_names))), rows.F]),
        states=[
            *(f"mode {n}" for n in plant.mode_index),
            *(f"lag {name}" for name in plant.source_names),
            *(f"beside {n}" for n in range(1, len(plant.decay_1_s) - plant.lag_slice.stop + 1)),
        ],
        inputs=[*plant.source_names, *plant.known_names],
        outputs=[f"row {r}" for r in range(len(rows.C))],
    )


class KimForm(NamedTuple):
    """dx/dt = A x + B q - D z,  y = C x + E z,  z = [l, dl/dt, r, dr/dt].

    `A` (N, N), `B` (N,) per W, `D` (N, 4), `C` (s, N), `E` (s, 4); x are the amplitudes of Θ = T − g l − h r.
    """

    A: FloatArray
    B: FloatArray
    C: FloatArray
    D: FloatArray
    E: FloatArray


def kim_form(modes: Modes, source: Stretch, sensor_m: FloatArray) -> KimForm:
    """Return Kim's equations (18) and (19) for one source and an ambient at 0 °C.

    The lifting functions g and h, which make the ends homogeneous, are the steady fields of the ends
    (straight lines without a film, as in the paper), so that L[g] = L[h] = 0 and only G = ∫ θ g/α dx and H
    are left of (11). An end that is not prescribed has no lifting function: its columns are zero. The
    product itself expands T in place of Θ, which needs no derivative of a measured temperature. Source: Kim
    et al., equations (4) to (19).
    """
    rod = modes.rod
    x, w = quadrature(rod.length_m, ())
    weighted = modes.theta(x).T * (w / rod.diffusivity_m2_s)
    D, E = np.zeros((len(modes), 4)), np.zeros((len(sensor_m), 4))
    for column, side, end in ((0, "left", rod.left), (2, "right", rod.right)):
        if end.prescribed:
            D[:, column + 1] = weighted @ end_field(rod, side, x)
            E[:, column] = end_field(rod, side, sensor_m)
    return KimForm(np.diag(-modes.decay_1_s), modal_input(modes, source), modes.theta(sensor_m), D, E)
