"""Parameters as arrays: those of the machine first, and what is learnt in the unit it is reported in."""

from __future__ import annotations

from typing import get_args

import numpy as np

from observer.config.estimator import Learnable
from observer.model.learning import Nuisance, Parameter, joined, learning_of, no_change, of_parameters


def parameters() -> list[Parameter]:
    """An offset, a law, a film and a place, in this order."""
    none = no_change(2, 1)
    return [
        Parameter(Nuisance.OFFSET, 1, 0.3, none._replace(shift_K=1.0), "t1.offset_K"),
        Parameter(Nuisance.LAW, 0, 0.2, none._replace(law=0), "nut.scale", 1.5, 1.5),
        Parameter(
            Nuisance.CONVECTION,
            0,
            0.1,
            none._replace(rate_1_s=np.array([-1.0, -2.0])),
            "film",
            15.0,
            15.0,
        ),
        Parameter(Nuisance.PLACE, 0, 0.002, none._replace(row=np.array([0.0, 3.0])), "t0.position_m", 0.2),
    ]


def test_those_of_the_machine_come_first() -> None:
    arrays = learning_of(parameters(), {"law", "offset_K"}, 2, 1).arrays
    assert arrays.machine == 2
    assert arrays.kind.tolist() == [
        Nuisance.LAW,
        Nuisance.CONVECTION,
        Nuisance.OFFSET,
        Nuisance.PLACE,
    ]
    assert arrays.of.tolist() == [0, 0, 1, 0]
    assert arrays.considered.tolist() == [1, 3]
    np.testing.assert_array_equal(arrays.sigma, [0.2, 0.1, 0.3, 0.002])
    np.testing.assert_array_equal(
        arrays.entries(np.array([5.0, 7.0]), np.array([3.0])), [0.0, 0.0, 1.0, 21.0]
    )
    some = of_parameters(arrays, np.array([1, 2, 3]))
    assert (some.machine, some.kind.tolist()) == (
        1,
        [Nuisance.CONVECTION, Nuisance.OFFSET, Nuisance.PLACE],
    )
    assert joined(arrays, some).kind.tolist() == [*arrays.kind.tolist(), *some.kind.tolist()]


def test_what_is_learnt_is_reported_as_a_value_and_its_sigma() -> None:
    learning = learning_of(parameters(), {"law", "convection", "offset_K"}, 2, 1)
    reported = learning.estimates(np.array([0.1, -0.2, 0.4, 9.0]), np.diag([0.01, 0.04, 0.09, 9.0]))
    assert list(reported) == ["nut.scale", "film", "t1.offset_K"]
    np.testing.assert_allclose(
        list(reported.values()), [(1.5 + 1.5 * 0.1, 1.5 * 0.1), (15.0 - 15.0 * 0.2, 15.0 * 0.2), (0.4, 0.3)]
    )


def test_every_kind_has_its_key_in_the_order_of_the_table() -> None:
    assert [(int(kind), kind.key) for kind in Nuisance] == list(enumerate(get_args(Learnable)))


def test_feedback_is_what_the_drives_change_with_the_state() -> None:
    rng = np.random.default_rng(6)
    rate_1_s, into, seen = rng.standard_normal((3, 2))
    tied = no_change(2, 1)._replace(rate_1_s=rate_1_s, into=into, feedback_row=seen)
    arrays = learning_of([*parameters(), Parameter(Nuisance.END, 0, 1.0, tied)], {"law"}, 2, 1).arrays
    theta, x, law_W, z = rng.standard_normal(len(arrays.kind)), rng.standard_normal(2), np.ones(1), np.ones(1)
    B = rng.standard_normal((2, 1))
    here = arrays.drives(x, B, law_W, law_W, z) @ theta
    moved = [arrays.drives(x + one, B, law_W, law_W, z) @ theta - here for one in np.eye(2)]
    np.testing.assert_allclose(arrays.feedback(theta), np.column_stack(moved), rtol=1e-12)
    still = learning_of(parameters()[:1], set(), 2, 1).arrays
    assert not still.drives(x, B, law_W, law_W, z).any(), "an offset of a sensor does nothing to the screw"
    np.testing.assert_array_equal(still.law, -1)
    np.testing.assert_array_equal(still.lag_s, 0.0)
