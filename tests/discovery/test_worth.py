"""What an effect is worth in thermal error, against cases whose answer is known."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from observer.config.machine import Config
from observer.discovery.worth import worth_of
from tests.logs.machines import config_of

ALPHA_1_K = 11.8e-6


def warm() -> Config:
    """A screw that grows, with sensors at 0.05, 0.5 and 0.95 m and a stroke up to 0.8 m."""
    config = config_of(5, 3, 5, moving=True)
    return config.model_copy(update={"screw": config.screw.model_copy(update={"expansion_1_K": ALPHA_1_K})})


def problem(error_K: Any, field_K: dict[str, float], config: Any, *, proof: Any = None) -> Any:
    """Two means of one run: errors by sensor and time, and predicted fields, the same everywhere."""
    error_K = np.asarray(error_K, dtype=float)
    b, s = error_K.shape
    evidence = SimpleNamespace(
        run=np.zeros(b * s, dtype=int),
        mean=np.repeat(np.arange(b), s),
        sensor=np.tile(np.arange(s), b),
        proof=np.ones(b * s, dtype=bool) if proof is None else np.repeat(proof, s),
    )
    ticks = SimpleNamespace(mean=np.repeat(np.arange(b), 3))

    def fields(model: str, x_m: Any) -> Any:
        return [(np.full((3 * b, len(x_m)), field_K[model]), np.zeros(3 * b))]

    forward = SimpleNamespace(runs=[SimpleNamespace(ticks=ticks)], fields=fields)
    return SimpleNamespace(
        config=config, evidence=evidence, forward=forward, error_K=lambda _: error_K.ravel()
    )


def test_a_field_that_is_wrong_everywhere_moves_the_far_end_of_the_stroke() -> None:
    config = warm()
    found = worth_of(
        problem([[0.0, 0.0, 0.0]] * 2, {"before": 20.0, "after": 22.0}, config), "before", "after"
    )  # type: ignore[arg-type]
    assert found is not None
    assert found.before_position_m == pytest.approx(0.8)
    assert found.before_rms_um == found.before_largest_um == pytest.approx(1e6 * ALPHA_1_K * 2.0 * 0.8)
    assert found.after_rms_um == 0.0


def test_what_remains_is_linear_between_the_sensors_and_only_the_proof_counts() -> None:
    config = warm()
    errors = [[9.0, 9.0, 9.0], [1.0, 1.0, 0.0]]
    proof = np.array([False, True])
    found = worth_of(problem(errors, {"b": 20.0, "a": 20.0}, config, proof=proof), "b", "a")  # type: ignore[arg-type]
    assert found is not None
    # 1 K up to 0.5 m, then falling by 0.3 / 0.45 K up to 0.8 m
    expected_um = 1e6 * ALPHA_1_K * (0.5 + 0.3 * (1.0 - 0.5 * 0.3 / 0.45))
    assert found.after_rms_um == pytest.approx(expected_um, rel=1e-3)
    assert found.before_rms_um == pytest.approx(found.after_rms_um)


def test_an_offset_that_only_a_sensor_shows_is_no_error_of_the_screw() -> None:
    """With the offset in the model nothing remains, and the fields are the same."""
    config = warm()
    found = worth_of(problem([[0.0, 0.0, 0.0]], {"b": 25.0, "a": 25.0}, config), "b", "a")  # type: ignore[arg-type]
    assert found is not None
    assert found.before_rms_um == 0.0


def test_without_expansion_nothing_is_said() -> None:
    config = config_of(5, 3, 5)
    assert worth_of(problem([[1.0, 1.0, 1.0]], {"b": 0.0, "a": 0.0}, config), "b", "a") is None  # type: ignore[arg-type]
