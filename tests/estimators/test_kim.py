"""Kim's gains: the printed formula, the closed form, and both against fifty digits."""

import mpmath
import numpy as np
import pytest

from observer.estimators.design.gains import gains_on_chain, gains_on_eigenvectors, kim_poles
from tests.reference.printed import kim_gains, kim_gains_printed

HEAT_AT, SENSOR_AT = 0.1, 0.43


def prescribed_rod(modes):
    """Λ, B, C of Kim's example in dimensionless time: prescribed ends, heat at 0.1 L, sensor at 0.43 L."""
    n = np.arange(1, modes + 1)
    return (
        (n * np.pi) ** 2,
        np.sqrt(2) * np.sin(n * np.pi * HEAT_AT),
        np.sqrt(2) * np.sin(n * np.pi * SENSOR_AT),
    )


def exact_gains(decay, B, C, poles):
    """Solve for [L; k] from the closed-loop characteristic polynomial at N + 1 points, with fifty digits.

    det(sI - A_cl) = s a(s) + s C adj(sI-A) L + k C adj(sI-A) B is linear in (L, k).
    """
    with mpmath.workdps(50):
        lam, b, c = ([mpmath.mpf(v) for v in row] for row in (decay, B, C))
        N = len(lam)
        points = [mpmath.mpf(i + 1) for i in range(N + 1)]
        A, rhs = mpmath.matrix(N + 1), mpmath.matrix(N + 1, 1)
        for row, s in enumerate(points):
            a = mpmath.fprod(s + v for v in lam)
            for i in range(N):
                A[row, i] = s * c[i] * a / (s + lam[i])
            A[row, N] = mpmath.fsum(c[i] * b[i] * a / (s + lam[i]) for i in range(N))
            rhs[row] = mpmath.fprod(s - mpmath.mpf(p) for p in poles) - s * a
        return mpmath.lu_solve(A, rhs)


@pytest.mark.parametrize(("modes", "digits"), [(2, 1e-12), (3, 1e-10), (5, 1e-7), (7, 1e-4)])
def test_closed_form_equals_fifty_digits_and_the_printed_formula_loses_some(modes, digits):
    """The printed matrix loses digits as its condition grows."""
    decay, B, C = prescribed_rod(modes)
    poles = kim_poles(decay, 1.0)
    exact = np.array([float(v) for v in exact_gains(decay, B, C, poles)])
    # A product of 2N factors, each good to an ulp, of which L's integrator share may cancel a digit or two.
    np.testing.assert_allclose(np.append(*kim_gains(decay, B, C, poles)), exact, rtol=1e-11)
    np.testing.assert_allclose(np.append(*kim_gains_printed(decay, B, C, poles)), exact, rtol=digits)


def test_kims_own_example_reaches_gains_no_sensor_can_bear():
    decay, B, C = prescribed_rod(7)
    poles = kim_poles(decay, 1.0)
    L, k = kim_gains(decay, B, C, poles)
    assert np.abs(L).max() > 1e11
    closed = np.block([[np.diag(-decay) - np.outer(L, C), B[:, None]], [-k * C, 0.0]])
    reached = np.linalg.eigvals(closed)
    assert np.abs(np.sort(reached.real) - np.sort(poles)).max() > 100


@pytest.mark.parametrize("modes", [2, 3, 4])
def test_gains_put_the_poles_where_they_were_asked(modes):
    decay, B, C = prescribed_rod(modes)
    poles = -(5.0 + 4.0 * np.arange(modes + 1))
    L, k = kim_gains(decay, B, C, poles)
    closed = np.block([[np.diag(-decay) - np.outer(L, C), B[:, None]], [-k * C, 0.0]])
    np.testing.assert_allclose(np.sort(np.linalg.eigvals(closed).real), np.sort(poles), rtol=1e-6)


def test_pole_rule_is_dimensionless():
    """The same screw in other units of time has the same poles: Λ and α/L² scale alike."""
    decay, _, _ = prescribed_rod(7)
    per_s = 1.67e-5 / 0.5**2
    np.testing.assert_allclose(kim_poles(decay * per_s, per_s), kim_poles(decay, 1.0) * per_s, rtol=1e-12)
    poles = kim_poles(decay, 1.0)
    assert poles[0] == pytest.approx(-3 * decay[-1])
    np.testing.assert_allclose(np.diff(poles), -1.0, atol=1e-9)


def test_chain_gains_place_a_double_eigenvalue():
    """A mode with the heat's own eigenvalue: diag blocks [[1, g], [0, 1]] and two other modes."""
    e, c, coupling, c_heat = np.array([1.0, 0.9, 0.7]), np.array([0.8, 0.5, -0.4]), 0.3, 0.2
    poles = np.array([0.5, 0.45, 0.4, 0.35])
    A = np.diag(np.append(e, 1.0))
    A[0, 3] = coupling
    g, heat = gains_on_chain(e, c, coupling, c_heat, poles)
    closed = A - np.outer(np.append(g, heat), np.append(c, c_heat))
    np.testing.assert_allclose(np.poly(closed), np.poly(poles), rtol=1e-10, atol=1e-12)


def test_chain_is_the_limit_of_distinct_eigenvalues():
    e, c, coupling, poles = np.array([1.0, 0.9]), np.array([0.8, 0.5]), 0.3, np.array([0.5, 0.45, 0.4])
    near, gap = np.array([1.0 - 1e-6, 0.9]), 1e-6
    v = coupling / gap
    g = gains_on_eigenvectors(np.append(near, 1.0), np.append(c, 0.2 + c[0] * v), poles)
    chain, heat = gains_on_chain(e, c, coupling, 0.2, poles)
    # The difference is of the order of the gap times the gains.
    np.testing.assert_allclose([g[0] + v * g[2], g[1], g[2]], [*chain, heat], rtol=1e-3)
