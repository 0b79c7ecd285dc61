"""What the smoother writes down on its way forward and takes back: records for its kernels."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from observer.frames import FloatArray


class Tape(NamedTuple):
    """What the backward pass needs of K steps of the filter.

    `kind` (K,); per sensor in the order of the corrections `gain` (K, s, width), `weight` (K, s) = 1/S, 0
    where it did not correct, and `innovation` (K, s) given the sensors before it; after the corrections the
    heats `heat` (K, m_e) and their rows of P, `cross` (K, m_e, width); where states are coupled, the state
    before each half of it, `coupled` (K, 2, n_x).
    """

    kind: NDArray[np.int8]
    gain: FloatArray
    weight: FloatArray
    innovation: FloatArray
    heat: FloatArray
    cross: FloatArray
    coupled: FloatArray


class Adjoint(NamedTuple):
    """What later measurements say of the state, in place: `r` (width,), `N` (n, width), scratch `NK`."""

    r: FloatArray
    N: FloatArray
    NK: FloatArray


class Smoothed(NamedTuple):
    """Where the backward pass writes: heats and their σ (K, m_e), residuals (K, s)."""

    heat: FloatArray
    sigma: FloatArray
    residual: FloatArray
