"""The open loop over many steps is the open loop over one step, many times."""

from __future__ import annotations

import numpy as np
import pytest

from observer.model.discretise import step_matrices
from observer.model.simulate import simulate, start
from tests.logs.inputs import lively
from tests.logs.plants import small


@pytest.mark.parametrize("moving", [(), (1,)])
def test_what_is_held_drives_like_what_is_given_anew(moving):
    """Laws that are held and change, an ambient that rests and rises, steps of several lengths."""
    plant = small(moving)
    steps = 60
    u = lively(plant, steps, nut_m=0.3 + 0.2 * np.sin(np.arange(steps)))
    u.law_W[:] = 5.0 * (np.arange(steps) // 7)[:, None] + np.arange(u.law_W.shape[1])
    u.law_W[20:22, 2] += 1.0
    u.z_start[30:45], u.z_end[30:44] = 20.0, 20.0
    u.dt_s[[10, 11, 40]] = 0.6, 0.6, 2.0
    begun = start(plant, 20.0, np.zeros(u.law_W.shape[1]))
    after, rows = simulate(plant, begun, u)
    x, own = begun, []
    for k in range(steps):
        x, row = simulate(plant, x, u.part(k, k + 1))
        own.append(row[0])
    np.testing.assert_array_equal(x, after)
    np.testing.assert_allclose(own, rows, rtol=1e-12)
    assert len(np.unique(rows[:, 0])) == steps


def test_whatever_is_driven_otherwise_than_the_step_before_is_driven_anew():
    """Steps are as long as the mark for none before, but for its sign; a law comes and goes at every step."""
    plant, steps = small(()), 12
    u = lively(plant, steps)
    u.dt_s[:] = 1.0
    u.law_W[:] = 5.0
    u.law_W[::2, 1] = 50.0
    u.z_start[:] = u.z_end[:] = 20.0
    begun = start(plant, 24.0, np.zeros(u.law_W.shape[1]))
    after, _ = simulate(plant, begun, u)
    x, B = begun, plant.B
    step = step_matrices(plant, 1.0)
    for k in range(steps):
        x = step.decay * x + step.hold * (B @ u.law_W[k] + plant.E @ u.z_start[k])
    np.testing.assert_allclose(after, x, rtol=1e-11)
