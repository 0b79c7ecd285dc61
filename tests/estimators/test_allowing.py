"""Observers with given gains on machines that are only roughly known."""

from functools import cache

import numpy as np
import pytest

from campaigns.learning.trial import FIRST_SEED, KNOWN
from observer.align.aligner import frames_of_log
from observer.estimate.pipeline import MachineModel
from observer.frames import EstimateBlock
from tests.learning.cover import judged, log_of
from tests.learning.machines import Rough, config_of, day, draw

KIND = {"luenberger": 'kind = "luenberger"\n', "constant": 'engine = "constant"\n'}


@cache
def a_day():
    return day(draw(1, 0, Rough()), 1, 0, "a", warm=True)


def set_up(more, steps):
    """The estimator of a configuration, and the inputs of the first steps of a log."""
    machine = MachineModel.of(config_of(more=more), learns=True)
    frames = next(iter(frames_of_log(log_of(a_day()), machine.plan)))
    _, u = machine.drive.run(machine.drive.initial(), frames)
    return machine.estimator(), u.part(0, steps)


@pytest.mark.parametrize("kind", KIND)
def test_many_steps_are_many_runs_of_one(kind):
    estimator, u = set_up("[estimator]\n" + KIND[kind], 200)
    whole, block = estimator.run(estimator.initial(), u)
    state = estimator.initial()
    for k in range(len(u)):
        state, one = estimator.run(state, u.part(k, k + 1))
        for name in EstimateBlock.__dataclass_fields__:
            np.testing.assert_array_equal(getattr(one, name)[0], getattr(block, name)[k], err_msg=name)
    np.testing.assert_array_equal(state.around, whole.around)


@pytest.mark.slow
def test_rough_machines_are_covered():
    """Four machines of the campaign's, half of them warm; without what is allowed for, a third is covered."""
    covered = {"known": [], "allowed": []}
    for number in range(4):
        one = day(
            draw(FIRST_SEED, number, Rough()), FIRST_SEED, number, "abc"[number % 3], warm=number % 2 == 1
        )
        for name, more in (("known", KNOWN), ("allowed", "[estimator]\n")):
            found = judged(config_of(more=more + KIND["luenberger"]), one)
            covered[name].append([found[q][1] for q in ("heats", "nut", "field")])
    assert (np.mean(covered["allowed"], axis=0) > 0.85).all()
    assert (np.mean(covered["known"], axis=0) < np.mean(covered["allowed"], axis=0)).all()
