"""The prediction within tolerances: what a parameter is said to do is what the changed machine does."""

from __future__ import annotations

import tomllib
from collections.abc import Callable

import numpy as np
import pytest

from observer.align.aligner import AlignPlan, frames_of_log
from observer.config.machine import Config
from observer.estimators.tolerant import Tolerant, TolerantState, gathered
from observer.frames import FloatArray, Inputs
from observer.model.build import build_plant
from observer.model.drive import Drive
from observer.model.learning import Nuisance
from observer.model.rod.moving import columns_at
from observer.model.simulate import simulate, start
from tests.learning.cover import log_of
from tests.learning.machines import AS_CONFIGURED, CONFIG, config_of, day, draw

MINUTES = 60
ROWS = 60
SHARE = 0.2


@pytest.fixture(scope="module")
def one_day():
    return day(draw(8000, 0, AS_CONFIGURED), 8000, 0, "a")


def _inputs(config: Config, one_day, minutes: int = MINUTES) -> Inputs:
    drive, log = Drive(config, build_plant(config, learns=True)), log_of(one_day)
    state, blocks = drive.initial(), []
    for frames in frames_of_log(log, AlignPlan.of(config)):
        state, inputs = drive.run(state, frames)
        blocks.append(inputs)
    return Inputs.joined(blocks).part(600, 600 + minutes * ROWS)


def _minutes(inputs: Inputs) -> list[Inputs]:
    return [gathered([inputs.part(k, k + ROWS)]) for k in range(0, len(inputs), ROWS)]


def _predicted(config: Config, inputs: Inputs) -> FloatArray:
    """The sensors by a plant's own simulation of every row, in means of a minute."""
    plant = build_plant(config)
    _, rows = simulate(plant, start(plant, 20.0, inputs.law_W[0]), inputs)
    return rows[:, plant.rows.sensor_slice].reshape(-1, ROWS, plant.rows.sensors).mean(axis=1)


def _gaps(inputs: Inputs, of: Nuisance | None = None, sigmas: float = 0.0) -> FloatArray:
    """What the prediction leaves of the readings, with one parameter of a kind off by so much."""
    config = config_of()
    plant = build_plant(config, learns=True)
    tolerant = Tolerant(plant)
    state = tolerant.initial()
    theta = np.zeros(len(state.theta))
    if of is not None:
        at = tolerant.parameters(of)[1 if of is Nuisance.PLACE else 0]
        theta[at] = sigmas * np.sqrt(state.P[len(state.x) + at, len(state.x) + at])
    state = TolerantState(start(plant, 20.0, inputs.law_W[0]), theta, state.P)
    gaps = []
    for minute in _minutes(inputs):
        state, gap = tolerant.ahead(state._replace(theta=theta), minute, learn=False)
        gaps.append(gap.gap_K)
    return np.array(gaps)


def _text(old: str, new: str) -> Config:
    assert old in CONFIG
    return Config.model_validate(tomllib.loads(CONFIG.replace(old, new, 1)))


CHANGED: dict[str, tuple[Nuisance, float, Callable[[], Config]]] = {
    "film": (Nuisance.CONVECTION, 1.0, lambda: _text("W_m2K = 15.0", "W_m2K = 19.5")),
    "conductivity": (Nuisance.CONDUCTIVITY, 1.0, lambda: _text("_W_mK = 50.0", "_W_mK = 51.5")),
    "heat capacity": (Nuisance.HEAT_CAPACITY, 1.0, lambda: _text("_J_kgK = 460.0", "_J_kgK = 473.8")),
    "end": (
        Nuisance.END,
        2.0,
        lambda: _text('kind = "insulated"', 'kind = "convective"\ncoefficient_W_m2K = 98.2438'),
    ),
    "law": (Nuisance.LAW, 1.0, lambda: _text("torque_Nm = 0.3", "torque_Nm = 0.36")),
    "place": (Nuisance.PLACE, 1.0, lambda: _text("position_m = 0.28", "position_m = 0.282")),
}


@pytest.mark.parametrize("name", CHANGED)
def test_a_parameter_does_what_the_changed_machine_does(name: str, one_day) -> None:
    """The changed configuration's own plant is the other one; a minute at a time costs a little."""
    kind, sigmas, changed = CHANGED[name]
    inputs = _inputs(config_of(), one_day)
    there = _predicted(changed(), _inputs(changed(), one_day)) - _predicted(config_of(), inputs)
    said = _gaps(inputs) - _gaps(inputs, kind, sigmas)
    largest = np.abs(there).max()
    assert largest > 0.02
    assert np.abs(said - there).max() < 0.1 * largest + 0.003  # a place moves nothing of a nut passing by


def test_the_tolerant_prediction_with_nothing_off_is_the_open_loop(one_day) -> None:
    inputs = _inputs(config_of(), one_day)
    y_degC = inputs.y_degC.reshape(MINUTES, ROWS, -1).mean(axis=1)
    expected = y_degC - _predicted(config_of(), inputs)
    assert np.ptp(y_degC) > 5.0
    apart_K = np.abs(_gaps(inputs) - expected)
    assert np.sqrt(np.mean(apart_K**2)) < 0.03
    assert apart_K.max() < 0.25  # a minute in which the work begins is no straight line


def test_a_parameter_ends_at_the_edge_of_its_tolerance(one_day) -> None:
    """A sensor 5 K off is beyond 3.5 × 0.3 K, and the air's 0.5 K: what is beyond stays, for days."""
    minute, tolerant = _still(one_day)[0], Tolerant(build_plant(config_of(), learns=True))
    state = tolerant.begin(tolerant.initial(), minute)
    for _ in range(3000):
        state, gap = tolerant.ahead(state, minute)
    offsets = state.theta[tolerant.parameters(Nuisance.OFFSET)]
    assert offsets[2] == pytest.approx(3.5 * 0.3)
    assert gap.gap_K[2] > 1.0


def _still(one_day) -> list[Inputs]:
    """Minutes of a machine at rest, whose third sensor reads 5 K too high."""
    inputs = _inputs(config_of(), one_day, 2)
    wrong = inputs.z_end[:, :1] + np.array([0.0, 0.0, 5.0, 0.0, 0.0])
    return _minutes(inputs._replace(law_W=np.zeros_like(inputs.law_W), y_degC=wrong))


def test_a_faulty_sensor_does_not_set_the_field_at_the_start(one_day) -> None:
    tolerant = Tolerant(build_plant(config_of(), learns=True))
    first, second = _still(one_day)
    _, gap = tolerant.ahead(tolerant.begin(tolerant.initial(), first), second)
    assert gap.gap_K[2] > 1.0
    assert np.abs(np.delete(gap.gap_K, 2)).max() < 0.5


@pytest.mark.parametrize(
    ("others", "stands"), [([0, 1], True), ([0], False)], ids=["two others", "one other"]
)
def test_one_of_three_may_have_gone_wrong_and_none_of_two(one_day, others: list[int], stands: bool) -> None:
    """If two differ, neither is known to be right: the field interpolates between them."""
    plant, (minute, _) = build_plant(config_of(), learns=True), _still(one_day)
    usable = np.zeros_like(minute.usable)
    usable[0, [*others, 2]] = True
    tolerant = Tolerant(plant)
    begun = tolerant.begin(tolerant.initial(), minute._replace(usable=usable))
    apart_K = np.ptp(plant.rows.C[plant.rows.sensor_slice] @ begun.x)
    assert apart_K < 0.5 if stands else apart_K > 4.0


def test_steps_are_gathered_as_their_means(one_day) -> None:
    inputs = _inputs(config_of(), one_day, 1)
    usable = inputs.usable.copy()
    usable[:30, 1] = usable[:, 2] = False
    inputs = inputs._replace(usable=usable)
    one = gathered([inputs.part(0, 20), inputs.part(20)])
    assert one.dt_s[0] == inputs.dt_s.sum()
    np.testing.assert_allclose(one.law_W[0], inputs.law_W.mean(axis=0))
    np.testing.assert_allclose(one.moving_B[0], inputs.moving_B.mean(axis=0))
    np.testing.assert_allclose(one.y_degC[0, 1], inputs.y_degC[30:, 1].mean())
    assert one.usable[0].tolist() == [True, True, False, True, True]
    assert (one.z_start[0] == inputs.z_start[0]).all()
    assert (one.z_end[0] == inputs.z_end[-1]).all()
    assert one.degraded[0] == 0
    assert gathered([inputs._replace(degraded=np.ones(60, np.int8))]).degraded[0] == 1


def test_a_law_that_is_off_shows_where_the_nut_is(one_day) -> None:
    """A nut stays at one place for a minute: its law's tolerance does what the changed law does there."""
    config = config_of()
    plant = build_plant(config, learns=True)
    tolerant, nut = Tolerant(plant), plant.moving[0]
    minute = _minutes(_inputs(config, one_day, 1))[0]
    B, C = columns_at(nut.table, [0.28])
    law_W = np.where(np.arange(minute.law_W.shape[1]) == nut.index, 100.0, minute.law_W)
    minute = minute._replace(moving_B=B[None, None], moving_C=C[None, None], law_W=law_W)
    more = minute._replace(law_W=np.where(law_W == 100.0, (1.0 + SHARE) * law_W, law_W))
    theta = np.zeros(len(tolerant.initial().theta))
    x, P = start(plant, 20.0, minute.law_W[0]), tolerant.initial().P
    off = theta.copy()
    laws = tolerant.parameters(Nuisance.LAW)[: plant.estimated.sum()]
    off[laws[np.flatnonzero(plant.estimated) == nut.index]] = SHARE
    (_, off_law), (_, changed) = (
        tolerant.ahead(TolerantState(x, t, P), u, learn=False) for t, u in ((off, minute), (theta, more))
    )
    np.testing.assert_allclose(off_law.gap_K, changed.gap_K, rtol=0, atol=1e-9)
