"""Which tests stand nearest to a module: what a mutant of it is put to."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parents[2]


@dataclass(frozen=True, slots=True)
class Nearest:
    """Arguments to pytest."""

    tests: tuple[str, ...]


def _at(*tests: str) -> Nearest:
    return Nearest(tests)


BITS = "tests/bits/test_bits.py"


def _bits(*cases: str) -> tuple[str, ...]:
    """Some of the recorded cases, where all of them would take a minute."""
    return tuple(f"{BITS}::test_the_bits_are_those_recorded[{case}]" for case in cases)


COUPLINGS = (
    "speed_loss", "films", "body_at_an_end", "body_at_the_nut", "lags", "radiation", "fading", "everything",
    "natural_convection",
)  # fmt: skip
AHEAD = _bits(
    "open_loop_eight_modes", "open_loop_a_nut", "open_loop_of_modes_that_do_not_decay",
    "open_loop_coupled_tightly", "open_loop_of_known_sweeps_alone", "open_loop_of_known_sweeps_with_all",
    *(f"open_loop_coupled_by_{name}" for name in COUPLINGS),
)  # fmt: skip
LEARNT = _bits(
    "kalman_that_learns_all_of_it", "kalman_that_learns_all_of_it_when_warm", "kalman_that_learns_nothing",
    "kalman_that_learns_laws_alone", "kalman_that_learns_end_W_K_alone", "kalman_that_learns_lag_s_alone",
    "kalman_that_learns_of_a_machine_that_runs", "kalman_that_learns_with_couplings",
)  # fmt: skip
SMOOTHED = _bits(
    "smoother_eight_modes", "smoother_a_nut", "smoother_one_heat", "smoother_of_what_is_refused_or_no_number",
    "smoother_of_sensors_that_say_almost_everything", *(f"smoother_coupled_by_{name}" for name in COUPLINGS),
)  # fmt: skip
NUTS = _bits("nut_columns", "nut_columns_at_places", "nut_columns_where_it_turns", "drive_of_two_nuts")
DRIVEN = _bits("drive_plain", "drive_effects", "drive_channels", "drive_without_a_nut", "drive_of_two_nuts")
SPECIFIED = "tests/estimators/test_specification.py"
KALMAN = _at("tests/estimators/test_steps.py", SPECIFIED, BITS)
GIVEN = _at("tests/estimators/test_given_gain.py", BITS)
PARTS = _at("tests/fit/test_parts.py")
GAINS = _at("tests/estimators/test_gains.py", "tests/estimators/test_kim.py")

NEAREST: dict[str, Nearest] = {
    "observer/discovery/experiment.py": _at("tests/discovery/test_experiment.py"),
    "observer/discovery/localise.py": _at("tests/discovery/test_phases.py"),
    "observer/discovery/search.py": _at("tests/discovery/test_search.py"),
    "observer/discovery/verdict.py": _at("tests/discovery/test_verdict.py"),
    "observer/estimators/design/gains.py": GAINS,
    "observer/estimators/design/steady.py": GAINS,
    "observer/estimators/selftest.py": _at("tests/estimators/test_selftest.py"),
    "observer/estimators/specification.py": _at(SPECIFIED, "tests/estimators/test_steps.py"),
    "observer/estimators/tolerant.py": _at(*_bits("tolerant_prediction"), "tests/gap/test_tolerant.py"),
    "observer/fit/calibrate.py": _at("tests/fit/test_calibrate.py"),
    "observer/fit/evidence.py": PARTS,
    "observer/fit/steps.py": _at("tests/fit/test_footprint.py"),
    "observer/fit/hypothesis.py": _at("tests/fit/test_parts.py", "tests/fit/test_minimise.py"),
    "observer/fit/parameters.py": _at("tests/fit/test_parameters.py"),
    "observer/fit/problem.py": PARTS,
    "observer/fit/process_noise.py": _at("tests/fit/test_process_noise.py"),
    "observer/fit/tolerance.py": PARTS,
    "observer/kernels/advance.py": _at(
        "tests/model/test_open_loop.py",
        *AHEAD,
        *_bits("kalman_five_sources", "kalman_coupled_by_everything", "settled_with_a_nut_constant"),
        SPECIFIED,
    ),
    "observer/kernels/changes.py": _at("tests/history/test_changes.py"),
    "observer/kernels/coupling.py": _at(
        "tests/model/test_generator.py", *AHEAD, *_bits(*(f"kalman_coupled_by_{name}" for name in COUPLINGS))
    ),
    "observer/kernels/covariance.py": _at("tests/kernels/test_covariance.py", SPECIFIED),
    "observer/kernels/exact_step.py": _at("tests/model/test_discretise.py", BITS),
    "observer/kernels/live.py": _at(
        "tests/model/test_drive.py", "tests/model/test_turning_surface.py", *DRIVEN
    ),
    "observer/kernels/fixed_gain.py": GIVEN,
    "observer/kernels/judging.py": KALMAN,
    "observer/kernels/kalman.py": KALMAN,
    "observer/kernels/learning.py": _at("tests/estimators/test_following.py", *LEARNT, SPECIFIED),
    "observer/kernels/path.py": _at("tests/model/test_path.py", "tests/model/test_moving.py", BITS),
    "observer/kernels/selftest.py": _at("tests/estimators/test_selftest.py", BITS),
    "observer/kernels/smoother.py": _at(
        "tests/history/test_smoother.py::test_a_short_history_of_coupled_states_equals_the_dense_posterior",
        *SMOOTHED,
    ),
    "observer/kernels/step.py": _at(
        "tests/estimators/test_steps.py", "tests/estimators/test_given_gain.py", SPECIFIED, BITS
    ),
    "observer/kernels/walk.py": _at("tests/align/test_align.py", "tests/align/test_dejitter.py", BITS),
    "observer/fit/linear.py": _at("tests/fit/test_linear_fit.py"),
    "observer/model/generator.py": _at("tests/model/test_basis.py"),
    "observer/model/couple.py": _at(
        "tests/model/test_couple.py",
        "tests/model/test_basis.py",
        "tests/model/test_generator.py",
        "tests/model/test_network.py",
    ),
    "observer/model/discretise.py": _at("tests/model/test_discretise.py"),
    "observer/model/learning.py": _at(
        "tests/model/test_learning.py",
        "tests/estimators/test_following.py",
        "tests/model/test_basis.py",
        "tests/history/test_changes.py",
        *LEARNT,
        SPECIFIED,
    ),
    "observer/model/rod/moving.py": _at("tests/model/test_path.py"),
    "observer/bus/codec.py": _at("tests/bus/test_codec.py"),
    "observer/align/aligner.py": _at("tests/align/test_align.py", "tests/record/test_can_log.py"),
}
