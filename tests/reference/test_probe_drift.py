"""Real probes that drift: calibrated on half a run, the other half lies within what is said of it."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

ROOT = Path(__file__).parents[2]
RUNS = sorted((ROOT / "tests" / "data" / "probe-drift").glob("*.json.gz"))


@pytest.fixture(scope="module")
def example() -> ModuleType:
    spec = importlib.util.spec_from_file_location(
        "probe_drift", ROOT / "docs" / "examples" / "probe_drift.py"
    )
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize("path", RUNS, ids=lambda path: path.name.split(".")[0])
def test_the_second_half_is_within_what_the_first_half_says(example: ModuleType, path: Path) -> None:
    one = example.drift(path)
    off_um, sigma_um = (one.probe_um - one.predicted_um)[one.second], one.sigma_um[one.second]
    assert len(off_um) > 100
    assert np.mean(np.abs(off_um) <= 1.96 * sigma_um) >= 0.9
    held_um = one.probe_um[one.second] - one.probe_um[~one.second & np.isfinite(one.probe_um)][-1]
    assert np.sqrt(np.mean(off_um**2)) < np.sqrt(np.mean(held_um**2))
    # it says something: less than what is seen to move
    assert sigma_um.max() < np.ptp(one.probe_um[np.isfinite(one.probe_um)])
