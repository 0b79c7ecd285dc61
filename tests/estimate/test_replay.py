"""A replay's files: every column of the contract, complete or not there, the same each time."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from observer.align.aligner import Aligner, frames_of_log
from observer.errors import LogError
from observer.estimate.pipeline import Pipeline
from observer.estimate.replay import estimates_of, result_columns, write_estimates
from observer.files.logs import Log, read_log
from observer.files.writer import TableWriter
from observer.frames import Reading
from tests.logs.recordings import CHANNELS, plan, play, write
from tests.service.fakes import FakeDrive, FakeEstimator


def _log(rows: int = 10_000) -> Log:
    rng = np.random.default_rng(5)
    values = rng.normal(25, 2, (rows, 3))
    values[rng.random((rows, 3)) < 0.05] = np.nan
    return Log(Path("run.csv"), np.cumsum(rng.uniform(0.1, 1, rows)), CHANNELS, values)


def _blocks(log: Log):
    pipeline = Pipeline(FakeDrive(), FakeEstimator())
    return [block for _, block in estimates_of(log, plan(), pipeline, lambda done, total: None)]


def _replay(log: Log, output: Path, suffix: str = ".csv", calls=None):
    calls = [] if calls is None else calls
    pipeline = Pipeline(FakeDrive(), FakeEstimator())
    with TableWriter(output / f"estimates{suffix}") as sink:
        return write_estimates(sink, log, plan(), pipeline, lambda done, total: calls.append((done, total)))


def test_columns_are_those_of_the_contract(tmp_path):
    _replay(_log(50), tmp_path)
    head = (tmp_path / "estimates.csv").read_text().splitlines()[0].split(",")
    assert head == [
        "time_s", "heat_nut_W", "heat_nut_sigma_W", "heat_nut_bound_W",
        "field_0_degC", "field_0_sigma_K", "field_0_bound_K",
        "field_2.225_degC", "field_2.225_sigma_K", "field_2.225_bound_K",
        "field_50_degC", "field_50_sigma_K", "field_50_bound_K",
        "error_0_um", "error_0_sigma_um", "error_0_bound_um",
        "error_2.225_um", "error_2.225_sigma_um", "error_2.225_bound_um",
        "error_50_um", "error_50_sigma_um", "error_50_bound_um",
        "innovation_t1_K", "quality_t1", "innovation_t2_K", "quality_t2", "quality",
        "heat_quality", "field_quality", "error_quality", "sensors_used", "sensors",
    ]  # fmt: skip


def test_each_bound_is_in_its_column_and_empty_where_unknown():
    layout, (block,) = FakeEstimator().layout, _blocks(_log(3))
    bounds = {"heat": np.array([[1.0], [np.nan], [2.0]]), "field": 3.0 + np.arange(9.0).reshape(3, 3)}
    calls = replace(
        block, heat_bound_W=bounds["heat"], field_bound_K=bounds["field"], error_bound_um=-bounds["field"]
    )
    columns = result_columns(layout, calls)
    np.testing.assert_array_equal(columns["heat_nut_bound_W"], bounds["heat"][:, 0])
    for j, mm in enumerate(("0", "2.225", "50")):
        np.testing.assert_array_equal(columns[f"field_{mm}_bound_K"], bounds["field"][:, j])
        np.testing.assert_array_equal(columns[f"error_{mm}_bound_um"], -bounds["field"][:, j])
    unknown = result_columns(layout, block)
    assert all(np.isnan(unknown[name]).all() for name in unknown if "bound" in name)


@pytest.mark.parametrize("suffix", [".csv", ".parquet"])
def test_the_file_holds_the_estimates_to_the_last_bit_however_they_are_cut_into_blocks(tmp_path, suffix):
    log = _log(5000)
    _replay(log, tmp_path, suffix)
    pipeline = Pipeline(FakeDrive(), FakeEstimator())
    field_degC = np.concatenate(
        [pipeline.step(frames).field_degC for frames in frames_of_log(log, plan(), 1)]
    )
    names = ["field_0_degC", "field_2.225_degC", "field_50_degC"]
    read = read_log(tmp_path / f"estimates{suffix}", names)
    assert (
        np.where(np.isnan(read.values), 0, read.values).tobytes()
        == np.where(np.isnan(field_degC), 0, field_degC).tobytes()
    )
    np.testing.assert_array_equal(np.isnan(read.values), np.isnan(field_degC))
    assert read.time_s.tobytes() == log.time_s.tobytes()


def test_the_summary_counts_and_is_the_same_each_time(tmp_path):
    log = _log()
    document = _replay(log, tmp_path / "one")
    assert json.dumps(document) == json.dumps(_replay(log, tmp_path / "two"))
    assert document["rows"] == len(log)
    assert document["duration_s"] == log.time_s[-1] - log.time_s[0]
    assert sum(document["quality"].values()) == len(log)
    missing = int(np.isnan(log.values[:, 0]).sum())
    assert document["sensors"]["t1"]["quality"] == {
        "good": len(log) - missing,
        "missing": missing,
        "stale": 0,
        "rejected": 0,
        "excluded": 0,
    }
    innovation = read_log(tmp_path / "one" / "estimates.csv", ["innovation_t1_K"]).values
    # two ways of adding up 10,000 numbers of size 1 agree to rounding
    assert document["sensors"]["t1"]["innovation_rms_K"] == pytest.approx(
        np.sqrt(np.nanmean(innovation**2)), rel=1e-12
    )
    heat_W = read_log(tmp_path / "one" / "estimates.csv", ["heat_nut_W"]).values
    assert document["heat_mean_W"]["nut"] == pytest.approx(np.nanmean(heat_W), rel=1e-12)


def test_progress_counts_rows_to_their_total(tmp_path):
    calls = []
    _replay(_log(), tmp_path, calls=calls)
    assert calls == [(4096, 10_000), (8192, 10_000), (10_000, 10_000)]


def test_a_failure_in_the_middle_leaves_nothing(tmp_path):
    log, estimator = _log(), FakeEstimator()

    def fail(done, total):
        estimator.fail = True

    with pytest.raises(ZeroDivisionError), TableWriter(tmp_path / "estimates.csv") as sink:
        write_estimates(sink, log, plan(), Pipeline(FakeDrive(), estimator), fail)
    assert list(tmp_path.iterdir()) == []


def test_a_recording_without_a_tick_is_rejected(tmp_path):
    _, data = play([Reading(0.0, {"t1_degC": 20.0})], Aligner(plan()))
    log = read_log(write(tmp_path, data), CHANNELS)
    with pytest.raises(LogError, match="no tick"):
        _replay(log, tmp_path / "out")
    assert list((tmp_path / "out").iterdir()) == []
