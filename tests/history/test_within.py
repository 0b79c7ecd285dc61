"""What tolerances leave to the heats of a log: beside dense equations, and on rough machines."""

from dataclasses import replace

import numpy as np
import pytest

from campaigns.learning.histories import FIRST_SEED, covered, identified
from campaigns.learning.trial import KNOWN
from observer.align.aligner import frames_of_log
from observer.config.effects.base import Unnamed
from observer.config.effects.terms import AmbientShift
from observer.config.estimator import EstimatorSettings
from observer.estimate.pipeline import MachineModel
from observer.estimate.replay import inputs_of
from observer.frames import Inputs
from observer.history.history import MethodOptions
from observer.history.identify import heat_history
from observer.history.smoother import smooth_heats
from observer.history.sweeps import Sweeps, readings
from observer.history.tolerances import Changes, averaged, changes_within, most_probable, without_changes
from observer.model.discretise import step_matrices
from observer.model.simulate import simulate, start_from_sensors
from tests.history.known_heats import DT_S, logged
from tests.learning.cover import log_of
from tests.learning.machines import AS_CONFIGURED, CONFIG, Rough, config_of, day, draw

OPEN_GATE = EstimatorSettings(gate_sigma=1e9)


def drifts(K, s):
    """Three slow changes of the sensors (K, s, 3), nothing at first: the start's level is what they say."""
    t = np.linspace(0.0, 1.0, K)[:, None]
    ramp = t * np.eye(s)[0]
    every = [0.4 * ramp, 0.3 * np.sin(3.0 * t) * np.ones(s), 0.5 * t**2 * np.linspace(-1.0, 1.0, s)]
    return np.stack(every, axis=2)


def held(plant, u):
    """The same prior for the smoother: heats that jump at the start of each step and are held over it."""
    jumps_W = np.tile(np.sqrt(step_matrices(plant, DT_S).walk_dd), (len(u), 1))
    plant = replace(plant, random_walk_W2_s=np.zeros(3), law_uncertainty=np.ones(3))
    return plant, u._replace(law_jump_W=jumps_W)


@pytest.mark.parametrize(
    "learnt", [(True, True, True), (True, False, True), (False, False, False)], ids=["all", "two", "none"]
)
def test_heats_and_their_variance_are_those_of_the_dense_equations(learnt):
    """Heats, tolerances and noise as one vector of independent numbers; estimate and error as matrices on it.
    The error's variance holds whatever the estimate makes of what it does not learn.
    """
    plant, u, _ = logged(steps=90)
    changes = Changes(drifts(90, 4), np.array(learnt))
    log, sweeps = readings(plant, [u], 1), Sweeps(plant, u, 1)
    n, weight = sweeps.unknowns, log.weight_1_K[:, :, None]
    S, H = sweeps.forward(np.eye(n))
    H, X, z = (
        (weight * H).reshape(-1, n),
        (weight * changes.sensor_K).reshape(-1, 3),
        weight[:, :, 0] * log.rise_K,
    )
    both = np.hstack([H, X])
    g = np.linalg.solve(both.T @ both + np.eye(n + 3), both.T)[n:] * np.array(learnt)[:, None]
    K = np.linalg.solve(H.T @ H + np.eye(n), H.T) @ (np.eye(len(H)) - X @ g)
    error = S.reshape(-1, n) @ np.hstack([K @ H - np.eye(n), K @ X, K])
    sigma_W = np.sqrt(np.sum(error**2, axis=1)).reshape(90, 3)[1:]
    heat_W = (S.reshape(-1, n) @ K @ z.ravel()).reshape(90, 3)[1:]

    same_plant, same_u = held(plant, u)
    found = most_probable(same_plant, OPEN_GATE, [same_u], changes)
    history = smooth_heats(same_plant, OPEN_GATE, without_changes([same_u], found.sensor_K))
    ours_W = np.sqrt(history.heat_sigma_W**2 + found.variance_W2)
    np.testing.assert_allclose(history.heat_W[1:], heat_W, rtol=0, atol=1e-6 * np.abs(heat_W).max())
    np.testing.assert_allclose(ours_W[1:], sigma_W, rtol=1e-5)
    assert (ours_W > 1.05 * history.heat_sigma_W).any(), "there is something to add"


@pytest.mark.parametrize("method", ["smoother", "tikhonov", "conjugate-gradient"])
def test_every_method_takes_learnt_off_the_readings_and_the_rest_into_sigma(method):
    plant, u, _ = logged(steps=90)
    options = MethodOptions(method)
    plain = heat_history(plant, OPEN_GATE, [u], options)
    same = heat_history(
        plant, OPEN_GATE, [u], options, lambda _heat_W: Changes(drifts(90, 4)[:, :, :0], np.zeros(0, bool))
    )
    np.testing.assert_array_equal(same.heat_W, plain.heat_W)
    np.testing.assert_array_equal(same.heat_sigma_W, plain.heat_sigma_W)
    ramp = np.ascontiguousarray(drifts(90, 4)[:, :, :1])
    known, learnt = (
        heat_history(plant, OPEN_GATE, [u], options, lambda _heat_W, by=by: Changes(ramp, np.array([by])))
        for by in (False, True)
    )
    np.testing.assert_array_equal(known.heat_W, plain.heat_W)
    assert (known.heat_sigma_W > 1.05 * plain.heat_sigma_W).any()
    assert np.abs(learnt.heat_W - plain.heat_W).max() > 0.0
    assert (learnt.heat_sigma_W <= known.heat_sigma_W + 1e-9).all() or method == "conjugate-gradient"


@pytest.mark.parametrize("size", [1.5, 9.0])
def test_a_misfit_that_tolerances_explain_is_no_reason_to_calibrate(size):
    """Faster than any heat, and only considered: once within its σ, and once far beyond it."""
    plant, u, _ = logged(steps=90)
    changes = Changes(drifts(90, 4), np.array([True, True, False]))
    changes.sensor_K[:, :, 2] = 0.3 * np.sin(np.arange(90.0))[:, None] * np.array([1.0, -1.0, 1.0, -1.0])
    log = u._replace(y_degC=u.y_degC + size * changes.sensor_K[:, :, 2])
    found = heat_history(plant, OPEN_GATE, [log], MethodOptions("tikhonov"), lambda _heat_W: changes)
    (said,) = found.warnings
    assert ("calibrate" in said) == (size > 3.0)
    assert ("σ includes it" in said) == (size < 3.0)


def of_morning(number):
    """The first twenty minutes of a rough machine's day."""
    one = day(draw(FIRST_SEED, number, Rough()), FIRST_SEED, number, "a")
    return one._replace(**{name: getattr(one, name)[:1200] for name in one._fields})


def test_with_all_tolerances_at_0_the_result_is_that_of_the_smoother_alone():
    one, config = of_morning(0), config_of(CONFIG, KNOWN)
    machine = MachineModel.of(config)
    blocks = inputs_of(frames_of_log(log_of(one), machine.plan), machine.drive)
    alone = heat_history(machine.plant, config.estimator, blocks, MethodOptions())
    ours = identified(config, one)
    for column in ("heat_W", "heat_sigma_W", "residual_K"):
        np.testing.assert_array_equal(getattr(ours, column), getattr(alone, column))


def test_each_tolerance_is_a_change_of_its_own_sensors_and_learnt_by_its_key():
    """Rows without a heat or an input change nothing; a sensor beside the screw has no place there."""
    one = of_morning(0)
    config = config_of(CONFIG, '\n[estimator]\nlearn = ["conductivity", "lag_s", "law"]\n')
    machine = MachineModel.of(config)
    one.air_degC[300:310] = np.nan
    blocks = inputs_of(frames_of_log(log_of(one), machine.plan), machine.drive)
    heat_W = one.heat_W.copy()
    heat_W[:5], heat_W[400:410] = np.nan, np.nan
    D, learnt = changes_within(config, blocks, heat_W)
    # film, material, air and ends of all sensors; offset, place and lag, then gain, of each of five
    assert learnt.tolist() == [False, True, *[False] * 4, *[False, False, True] * 5, *[False] * 5]
    assert np.isfinite(D).all()
    assert np.count_nonzero(D.any(axis=0), axis=0).tolist() == [5] * 6 + [1] * 20
    np.testing.assert_array_equal(D[10:, :, 6:21:3].max(axis=(0, 1)), [0.3] * 5)
    assert not D[:5].any(), "nothing is known yet"
    # what lags reads later by 4 s: while a sensor warms evenly that is 4 s of its slope
    warming = np.gradient(np.convolve(one.sensor_degC[:, 0], np.ones(60) / 60.0, "same"))
    assert D[900:1100, 0, 8].mean() == pytest.approx(-4.0 * warming[900:1100].mean(), rel=0.2)
    assert not len(changes_within(config, blocks, np.full_like(heat_W, np.nan)).learnt)


def predicted(config, one):
    """What sensors would read along the true heats from the start that their first values show, and the air,
    by the open loop of a configuration.
    """
    machine = MachineModel.of(config)
    u = Inputs.joined(inputs_of(frames_of_log(log_of(one), machine.plan), machine.drive))
    plant, u = machine.plant.sensors_only(), u.sensors_only(machine.plant.rows.sensors)
    u.law_W[:] = one.heat_W
    start = start_from_sensors(plant, u.y_degC[0], plant.noise_R_K2, u.law_W[0], u.z_end[0])
    return simulate(plant, start, u.part(1))[1], u.z_end[1:, [plant.known.ambient]]


def test_changes_are_those_of_other_configurations_along_the_same_heats():
    """A hundredth of each tolerance up and down, beside the description that the filter learns by."""
    one, config = of_morning(1), config_of()
    machine = MachineModel.of(config)
    blocks = inputs_of(frames_of_log(log_of(one), machine.plan), machine.drive)
    D, _ = changes_within(config, blocks, one.heat_W)
    known, screw = config.tolerance, config.screw

    def by(change):
        up, down = (predicted(config.model_copy(update=change(part)), one)[0] for part in (0.01, -0.01))
        return (up - down) / 0.02

    def film(part):
        more = config.surface.convection_W_m2K * (1.0 + part * known.convection)
        return {"surface": config.surface.model_copy(update={"convection_W_m2K": more})}

    def conductivity(part):
        more = screw.conductivity_W_mK * (1.0 + part * known.conductivity)
        return {"screw": screw.model_copy(update={"conductivity_W_mK": more})}

    def capacity(part):
        more = screw.specific_heat_J_kgK * (1.0 + part * known.heat_capacity)
        return {"screw": screw.model_copy(update={"specific_heat_J_kgK": more})}

    def air(part):
        return {"effect": (Unnamed((AmbientShift(0.0, part * known.ambient_K),)),)}

    # what the dropped modes hold goes with conductivity at once, and is not in the description
    near = {film: 0.01, conductivity: 0.15, capacity: 0.02, air: 0.01}
    for column, (change, part) in enumerate(near.items()):
        expected_K = by(change)
        largest_K = np.abs(expected_K).max()
        assert largest_K > 0.02
        np.testing.assert_allclose(D[1:, :, column], expected_K, rtol=0, atol=part * largest_K)
    reading_degC, air_degC = predicted(config, one)
    ours_K = np.diagonal(D[1:, :, -5:], axis1=1, axis2=2)
    np.testing.assert_allclose(ours_K, known.gain * (air_degC - reading_degC), rtol=0, atol=1e-3)


def test_a_gain_alone_is_taken_along_the_same_field():
    """With every other tolerance at 0 there is nothing that the filter learns by."""
    one, config = of_morning(1), config_of()
    alone = config_of(CONFIG, KNOWN.replace("gain = 0.0", f"gain = {config.tolerance.gain}"))
    machine = MachineModel.of(config)
    blocks = inputs_of(frames_of_log(log_of(one), machine.plan), machine.drive)
    every, gains = (changes_within(c, blocks, one.heat_W).sensor_K for c in (config, alone))
    assert gains.shape[2] == 5
    np.testing.assert_allclose(gains, every[:, :, -5:], rtol=0, atol=1e-9)


@pytest.mark.parametrize("number", range(3))
def test_tolerances_leave_the_heat_of_an_exactly_right_machine_as_it_is(number):
    """With changes along heats that follow the noise, the nut of these machines is 1.0 to 1.6 % too cold."""
    one = day(draw(41_000, number, AS_CONFIGURED), 41_000, number, "abc"[number])
    history = identified(config_of(), one)
    running = one.heat_W[:, 0] > 0.0
    off_W = np.nanmean(history.heat_W[running, 0]) - one.heat_W[running, 0].mean()
    assert abs(off_W) < 0.1 * np.nanmean(history.heat_sigma_W[running, 0])


def test_heats_are_averaged_beside_their_laws_over_uneven_rows_and_gaps():
    """A jump of the law stays where it is; a departure that alternates from row to row averages out."""
    plant, u, _ = logged(steps=90)
    law_W = u.law_W[:, plant.estimated]
    noise_W = 5.0 * (-1.0) ** np.arange(90)[:, None]
    heat_W = 1.2 * law_W.mean(axis=0) - law_W.mean(axis=0) + law_W + noise_W
    heat_W[:4] = np.nan
    smooth_W = averaged([u.part(0, 40), u.part(40)], plant.estimated, heat_W)
    assert np.isnan(smooth_W[:4]).all()
    rows = 300.0 / DT_S
    expected_W = law_W[4:] + 0.2 * law_W.mean(axis=0)
    assert np.abs(smooth_W[4:] - expected_W).max() < 5.0 / (rows / 2.0 - 1.0)


@pytest.mark.slow
def test_true_heats_of_rough_machines_lie_within_their_95_percent_bands():
    """Four of the campaign's sixteen, two of which began warm; before any was drawn
    90 to 98 % were asked for.
    Bands that take everything for known hold the truth in 24 %.
    """
    inside = []
    for number in range(4):
        one = day(
            draw(FIRST_SEED, number, Rough()), FIRST_SEED, number, "abc"[number % 3], warm=number % 2 == 1
        )
        inside.append(covered(identified(config_of(), one), one)[1].mean())
    assert np.mean(inside) >= 0.90
