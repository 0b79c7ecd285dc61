"""The poles of Kim's gains as they are stored, against eigenvalues by another algorithm with 80 digits."""

from pathlib import Path

import mpmath
import numpy as np
import pytest

from observer.estimate.pipeline import MachineModel
from observer.estimators.design import gains
from observer.estimators.design.exact_poles import exact_poles
from observer.estimators.design.report import design_report
from observer.installation import load
from observer.model.discretise import StepMatrices, step_matrices
from observer.model.plant import Plant

ROD = Path(__file__).parents[2] / "config" / "kim-rod.toml"


def _rod(period_s: float) -> tuple[Plant, StepMatrices, gains.LuenbergerGain]:
    """Kim's rod with the paper's rule and steps of `period_s`."""
    plant = MachineModel.of(load(ROD)).plant
    step = step_matrices(plant, period_s)
    gain = gains.design_kim(plant, step, gains.everything(plant))
    assert isinstance(gain, gains.LuenbergerGain)
    return plant, step, gain


@pytest.mark.parametrize("period_s", [1.0, 20.0, 120.0])
def test_poles_of_stored_gains_are_those_that_eighty_digits_give(period_s: float) -> None:
    plant, step, gain = _rod(period_s)
    Ad, _ = gains.design_step(plant, step)
    with mpmath.workdps(80):
        A, C, K = (mpmath.matrix(a.tolist()) for a in (Ad, gains.sensor_rows(plant), gain.K))
        eigenvalues = mpmath.eig(A - K * (C * A), left=False, right=False)
        expected = np.array([complex(mpmath.log(z) / step.dt_s) for z in eigenvalues])
    reached = exact_poles(plant, step, gain.K)
    # double precision holds the results to some 1e-16 of the largest; 1e-12 leaves room for conversions
    apart = np.abs(reached[:, None] - expected[None, :]).min(axis=1)
    assert len(reached) == len(expected)
    assert apart.max() < 1e-12 * np.abs(expected).max()
    assert (np.diff(reached.real) <= 1e-12 * np.abs(expected).max()).all()


def test_the_stored_gains_of_short_steps_have_poles_near_those_asked_for() -> None:
    """Eight within 15 %; a routine in double precision says that some are more than twice as far off."""
    plant, step, gain = _rod(1.0)
    exact = gain._replace(poles_reached_1_s=exact_poles(plant, step, gain.K)[: len(gain.poles_requested_1_s)])
    assert 0.05 < exact.pole_error < 0.15
    assert gain.pole_error > 1.0


def test_check_reports_the_poles_of_the_stored_gains() -> None:
    plant = MachineModel.of(load(ROD)).plant
    settings = load(ROD).estimator.model_copy(update={"pole_rule": "kim", "period_s": 1.0})
    report = design_report(plant, settings)
    moved = report.poles_reached_1_s[np.abs(report.poles_reached_1_s) > 700 * plant.diffusion_rate_1_s]
    scaled = moved / plant.diffusion_rate_1_s
    assert len(scaled) == 8
    assert -1700 < scaled.real.min() < -1500
    assert -1400 < scaled.real.max() < -1300
    assert np.abs(scaled.imag).max() < 200
    assert any("rounding the gains" in warning for warning in report.warnings)


def test_poles_of_a_well_conditioned_design_are_those_of_double_precision() -> None:
    plant = MachineModel.of(load(ROD)).plant
    step = step_matrices(plant, 120.0)
    gain = gains.design_bandwidth(plant, step, gains.everything(plant), 0.003)
    assert isinstance(gain, gains.LuenbergerGain)
    reached = exact_poles(plant, step, gain.K)[: len(gain.poles_requested_1_s)]
    np.testing.assert_allclose(reached, gain.poles_reached_1_s, rtol=1e-6)
