"""What `check` and `calibrate` are given."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from observer.config.estimator import EstimatorSettings
from observer.estimators.design.report import design_report
from observer.fit.process_noise import fit_process_noise, innovations_log_likelihood
from observer.model.discretise import augmented, step_matrices
from tests.logs.inputs import inputs, temperatures
from tests.logs.plants import LENGTH_M, rod

KIM = Path("config/kim-screw.toml")


@pytest.mark.parametrize("kind", ["kalman", "luenberger"])
def test_report_names_poles_noise_and_losses(kind):
    plant = rod()
    report = design_report(plant, EstimatorSettings(kind=kind))
    assert len(report.eigenvalues_1_s) == len(plant.decay_1_s) + 3
    assert set(report.noise_gain_W_K) == {"q0", "q1", "q2"}
    assert all(0 < g < 1e3 for g in report.noise_gain_W_K.values())
    assert report.poles_reached_1_s.real.max() < 0
    assert (len(report.poles_requested_1_s) > 0) == (kind == "luenberger")
    assert ("t0", "t1") in report.undetermined
    assert report.warnings == ()


def test_report_warns_of_kims_gains():
    plant = rod(sensors_m=(0.2,), sources_m=(0.3,), modes=7)
    report = design_report(plant, EstimatorSettings(kind="luenberger", pole_rule="kim"))
    assert any("poles reached" in w and "bandwidth" in w for w in report.warnings)
    assert any("without t0" in w for w in report.warnings)


def test_report_warns_of_a_mode_that_no_sensor_sees():
    """cos(3πx/L) has its nodes at L/6, L/2 and 5L/6."""
    plant = rod(sensors_m=(LENGTH_M / 6, 5 * LENGTH_M / 6), sources_m=(0.1,), grid=41)
    report = design_report(plant, EstimatorSettings())
    assert report.weakest_mode == 4
    assert report.weakest_mode_share == pytest.approx(0.0, abs=1e-9)
    assert any("mode 4" in w and "observer place" in w for w in report.warnings)


def test_report_says_that_no_gain_exists():
    report = design_report(rod(sensors_m=(0.2,)), EstimatorSettings())
    assert any("do not serve" in w for w in report.warnings)
    assert len(report.poles_reached_1_s) == 0


def test_likelihood_is_that_of_the_joint_normal_distribution():
    """All measurements after the first frame are jointly normal; their density needs no filter at all."""
    plant = rod(law_uncertainty=0.3)
    u = inputs(plant, steps=12, missing=0.2, dt_s=20.0, seed=3)
    from observer.estimators.kalman import KalmanEstimator

    estimator = KalmanEstimator(plant, EstimatorSettings(gate_sigma=1e9))
    first, _ = estimator.run(estimator.initial(), u.part(0, 1))
    Ad, Qd = augmented(plant, step_matrices(plant, 20.0))
    step, n_x = step_matrices(plant, 20.0), len(plant.decay_1_s)
    H = np.hstack([plant.rows.C[:4], np.zeros((4, 3))])
    n, K = len(first.x_hat), len(u) - 1
    mean, cov = first.x_hat, first.P
    means, carry, total = [], [], np.zeros((n * K, n * K))
    for k in range(1, K + 1):
        jump = np.zeros((n, n))
        jump[n_x:, n_x:] = np.diag((plant.law_uncertainty * u.law_jump_W[k]) ** 2)
        mean = Ad @ mean
        mean[:n_x] += step.hold * (plant.B @ u.law_W[k] + plant.E @ u.z_start[k])
        mean[:n_x] += step.ramp * (plant.E @ (u.z_end[k] - u.z_start[k]))
        carry = [Ad @ c for c in carry] + [np.eye(n)]
        cov = Ad @ (cov + jump) @ Ad.T + Qd
        means.append(mean)
        i = (k - 1) * n
        total[i : i + n, i : i + n] = cov
        for j in range(k - 1):
            block = np.linalg.matrix_power(Ad, k - 1 - j) @ total[j * n : j * n + n, j * n : j * n + n]
            total[i : i + n, j * n : j * n + n] = block
            total[j * n : j * n + n, i : i + n] = block.T
    Hs = np.kron(np.eye(K), H)[u.usable[1:].ravel()]
    y = u.y_degC[1:].ravel()[u.usable[1:].ravel()]
    R = np.tile(plant.noise_R_K2, K)[u.usable[1:].ravel()]
    expected = multivariate_normal(Hs @ np.concatenate(means), Hs @ total @ Hs.T + np.diag(R)).logpdf(y)
    assert innovations_log_likelihood(plant, u) == pytest.approx(expected, rel=1e-8)


def test_process_noise_of_a_log_is_found():
    plant = rod(sources_m=(0.1,), sensors_m=(0.08, 0.3), walk_W_sqrt_s=1e-2)
    rng = np.random.default_rng(5)
    u = inputs(plant, steps=3000, missing=0.0, law_steps=False, dt_s=2.0)
    walk = np.cumsum(0.5 * np.sqrt(2.0) * rng.normal(size=3000))
    u.y_degC[:] = temperatures(plant, u, lambda t: np.array([walk[round(t / 2.0)]]))
    found = fit_process_noise(plant, lambda tried: -innovations_log_likelihood(tried, u))
    # The walk is seen over about 3000 s / (response time of some 30 s): a factor of 1.25 is four standard
    # errors.
    assert 0.5 / 1.25 < found[0] < 0.5 * 1.25
    fitted = replace(plant, random_walk_W2_s=found**2)
    assert innovations_log_likelihood(fitted, u) > innovations_log_likelihood(plant, u)
