"""One exact step against the matrix exponential."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import expm

from observer.model.discretise import augmented, quantise, step_matrices
from tests.logs.plants import rod


def van_loan(plant, dt_s):
    """Ad and Qd by the exponential of the doubled matrix (Van Loan, 1978)."""
    n_x, m_e = len(plant.decay_1_s), int(plant.estimated.sum())
    n = n_x + m_e
    A = np.zeros((n, n))
    A[:n_x, :n_x] = -np.diag(plant.decay_1_s)
    A[:n_x, n_x:] = plant.B[:, plant.estimated]
    A[n_x:, n_x:] = -np.diag(plant.heat_decay_1_s)
    Qc = np.zeros((n, n))
    Qc[n_x:, n_x:] = np.diag(plant.random_walk_W2_s)
    block = expm(np.block([[-A, Qc], [np.zeros((n, n)), A.T]]) * dt_s)
    Ad = block[n:, n:].T
    return Ad, Ad @ block[:n, n:]


@pytest.mark.parametrize("film", [0.0, 15.0])
@pytest.mark.parametrize("heat_rate", [0.0, 1e-3])
@pytest.mark.parametrize("dt_s", [0.1, 2.0, 30.0])
def test_step_and_noise_are_those_of_the_matrix_exponential(film, heat_rate, dt_s):
    plant = rod(film_W_m2K=film, heat_rate_1_s=heat_rate)
    Ad, Qd = augmented(plant, step_matrices(plant, dt_s))
    Ad_exact, Qd_exact = van_loan(plant, dt_s)
    # repeated squaring costs the exponential six digits of what has almost faded
    np.testing.assert_allclose(Ad, Ad_exact, rtol=1e-9, atol=1e-14)
    # The exponential of the doubled matrix itself keeps about nine digits of the smallest entries.
    scale = np.sqrt(np.outer(np.diag(Qd_exact), np.diag(Qd_exact)))
    np.testing.assert_allclose(Qd / scale, Qd_exact / scale, atol=1e-8)


def test_known_inputs_ramp_exactly():
    plant = rod()
    dt_s, rate = 3.0, plant.decay_1_s
    step = step_matrices(plant, dt_s)
    s = np.linspace(0.0, dt_s, 20001)
    ramp = np.trapezoid(np.exp(-rate[:, None] * (dt_s - s)) * s / dt_s, s, axis=1)
    # The trapezoidal rule with 20,000 panels is good to (λ ds)²/12 ≈ 1e-12.
    np.testing.assert_allclose(step.ramp, ramp, rtol=1e-8)
    np.testing.assert_allclose(step.hold, (1 - np.exp(-rate * dt_s)) / rate, rtol=1e-11)


@pytest.mark.parametrize("rate", [0.0, 1e-18, 1e-9, 0.99e-2, 1.01e-2])
def test_slow_modes_do_not_cancel(rate):
    """hold → dt (1 - u/2 + u²/6) and ramp → dt (1/2 - u/6 + u²/24) for u = λ dt → 0, on both sides of the
    series' end.
    """
    plant = rod(modes=2)
    step = step_matrices(replace(plant, decay_1_s=np.full_like(plant.decay_1_s, rate)), 1.0)
    assert step.hold[0] == pytest.approx(1 - rate / 2 + rate**2 / 6 - rate**3 / 24, rel=1e-9)
    assert step.ramp[0] == pytest.approx(1 / 2 - rate / 6 + rate**2 / 24 - rate**3 / 120, rel=1e-9)


def test_time_must_not_run_backwards():
    with pytest.raises(ValueError, match="times must increase"):
        step_matrices(rod(), -0.1)


def test_steps_of_epoch_seconds_are_all_alike():
    time_s = 1.7635e9 + 0.1 * np.arange(1000)
    assert len(set(np.diff(time_s))) > 1
    assert set(quantise(np.diff(time_s))) == {0.1}


@pytest.mark.parametrize(
    ("step_s", "quantised_s"), [(1 / 3, 0.333333), (0.0004996, 0.0005), (0.0015, 0.0015), (4.9e-7, 0.0)]
)
def test_steps_keep_their_microseconds(step_s, quantised_s):
    """A tick of 300 Hz or of a third of a second is no whole number of milliseconds."""
    assert quantise(np.array([step_s, 1e4 + step_s])) == pytest.approx(
        [quantised_s, 1e4 + quantised_s], rel=0, abs=1e-11
    )
