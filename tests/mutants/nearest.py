"""Which tests stand nearest to a module: what a mutant of it is put to."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parents[2]


@dataclass(frozen=True, slots=True)
class Nearest:
    """Arguments to pytest; `compiled` where the kernels must run compiled to be through in a minute.

    Interpreted, a kernel takes up to a thousand times as long; a mutant in a kernel always runs so. A module
    without kernels is put to tests with compiled ones where those take long.
    """

    tests: tuple[str, ...]
    compiled: bool = False


def _at(*tests: str, compiled: bool = False) -> Nearest:
    return Nearest(tests, compiled)


BITS = "tests/bits/test_bits.py"
KALMAN = _at("tests/estimators/test_steps.py", "tests/estimators/test_specification.py", BITS)
SETTLED = _at("tests/estimators/test_settled.py", BITS)
PARTS = _at("tests/fit/test_parts.py")
GAINS = _at("tests/estimators/test_gains.py", "tests/estimators/test_kim.py", compiled=True)

NEAREST: dict[str, Nearest] = {
    "observer/discovery/experiment.py": _at("tests/discovery/test_experiment.py", compiled=True),
    "observer/discovery/phases.py": _at("tests/discovery/test_phases.py"),
    "observer/discovery/proof.py": _at("tests/discovery/test_verdict.py"),
    "observer/discovery/search.py": _at("tests/discovery/test_search.py", compiled=True),
    "observer/discovery/verdict.py": _at("tests/discovery/test_verdict.py"),
    "observer/estimators/design/gains.py": GAINS,
    "observer/estimators/design/riccati.py": GAINS,
    "observer/estimators/selftest.py": _at("tests/estimators/test_selftest.py", compiled=True),
    "observer/fit/calibrate.py": _at("tests/fit/test_calibrate.py", compiled=True),
    "observer/fit/evidence.py": PARTS,
    "observer/fit/footprint.py": _at("tests/fit/test_footprint.py", compiled=True),
    "observer/fit/hypothesis.py": PARTS,
    "observer/fit/minimise.py": _at("tests/fit/test_minimise.py"),
    "observer/fit/parameters.py": _at("tests/fit/test_parameters.py"),
    "observer/fit/problem.py": PARTS,
    "observer/fit/process_noise.py": _at("tests/fit/test_process_noise.py", compiled=True),
    "observer/fit/tolerance.py": PARTS,
    "observer/kernels/columns.py": SETTLED,
    "observer/kernels/cruise.py": SETTLED,
    "observer/kernels/discretise.py": _at("tests/model/test_discretise.py", BITS),
    "observer/kernels/cells.py": _at("tests/page/test_rows.py"),
    "observer/kernels/evening.py": _at("tests/service/test_evening.py", BITS),
    "observer/kernels/fixed_gain.py": SETTLED,
    "observer/kernels/judging.py": KALMAN,
    "observer/kernels/kalman.py": KALMAN,
    "observer/kernels/path.py": _at("tests/model/test_path.py", BITS),
    "observer/kernels/selftest.py": _at("tests/estimators/test_selftest.py", BITS),
    "observer/kernels/step.py": KALMAN,
    "observer/kernels/stuck.py": _at("tests/service/test_align.py", BITS),
    "observer/model/discretise.py": _at("tests/model/test_discretise.py"),
    "observer/model/rod/path.py": _at("tests/model/test_path.py"),
    "observer/publish/codec.py": _at("tests/publish/test_codec.py"),
    "observer/service/align.py": _at("tests/service/test_align.py", "tests/service/test_can_log.py"),
}
