"""Poles of a closed loop with exactly the stored gains, computed with enough digits.

Nearly equal poles are the most sensitive eigenvalues. A routine in double precision misses those of Kim's
rule by thousands of α/L², although the stored gains have poles near the requested ones. Here every stored
number is taken as exact. A Householder reduction to Hessenberg form and the recurrence of Hyman give the
characteristic polynomial, whose roots are the poles. Source: Wilkinson (1965), The Algebraic Eigenvalue
Problem, chapter 7.
"""

from __future__ import annotations

from typing import Any

import mpmath
import numpy as np

from observer.estimators.design.gains import ComplexArray, sensor_rows
from observer.frames import FloatArray
from observer.model.discretise import StepMatrices
from observer.model.generator import design_step
from observer.model.plant import Plant

MOST_STATES = 40
"""More take too long: with 40 states the roots take some seconds."""
_LEAST_DIGITS, _DIGITS_A_STATE = 80, 8
_STEPS, _EXTRA_BITS = 500, 400
_REAL = 1e-30
"""An imaginary part below this share of the pole is what the digits leave of zero."""


def exact_poles(plant: Plant, step: StepMatrices, K: FloatArray) -> ComplexArray:
    """Return log(eig (I - K C) Ad)/dt of the closed loop, 1/s, the slowest first.

    Poles at z = 0 are left out. Use it up to `MOST_STATES`: the time grows steeply with the states.

    Args:
        plant: The model.
        step: Matrices of the step dt.
        K: Stored gain, (n, s), taken as exact.
    """
    Ad, _ = design_step(plant, step)
    with mpmath.workdps(max(_LEAST_DIGITS, _DIGITS_A_STATE * len(Ad))):
        A, C, gain = (mpmath.matrix(array.tolist()) for array in (Ad, sensor_rows(plant), K))
        polynomial = _characteristic_polynomial(A - gain * (C * A))[::-1]
        roots = mpmath.polyroots(polynomial, maxsteps=_STEPS, extraprec=_EXTRA_BITS, asc=True)
        poles = np.array([complex(mpmath.log(z) / step.dt_s) for z in roots if z != 0])
    poles = np.where(np.abs(poles.imag) < _REAL * np.abs(poles), poles.real, poles)
    return np.asarray(poles[np.lexsort((poles.imag, -poles.real))], dtype=np.complex128)


def _characteristic_polynomial(M: Any) -> list[Any]:
    """Return the coefficients of det(z I - M), that of the highest power first."""
    _, H = mpmath.hessenberg(M)
    leading = [[mpmath.mpf(1)]]  # of the leading k rows and columns
    for k in range(M.rows):
        polynomial = [*leading[k], mpmath.mpf(0)]
        below = mpmath.mpf(1)
        for i in range(k, -1, -1):
            shift = len(polynomial) - len(leading[i])
            for j, coefficient in enumerate(leading[i]):
                polynomial[shift + j] -= H[i, k] * below * coefficient
            if i > 0:
                below *= H[i, i - 1]
        leading.append(polynomial)
    return leading[-1]
