"""A checkpoint gives back every bit, or says why it cannot; nothing in a file can do more than that."""

import hashlib
import math
import os
import stat
from dataclasses import fields, is_dataclass, replace
from pathlib import Path

import cbor2
import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from observer.align.aligner import frames_of_log
from observer.config.publishing import STATE_DIRECTORY, Checkpoint, RecordSettings
from observer.control import compensation
from observer.control.zero import ZeroPoint
from observer.estimate import checkpoint
from observer.estimate.checkpoint import (
    CheckpointFit,
    Snapshot,
    UnfitError,
    load,
    pack,
    recent,
    shifted,
    unpack,
)
from observer.estimate.pipeline import MachineModel
from observer.estimate.replay import estimates_of
from observer.estimators.protocol import SCREENING_VERDICT, SENSOR_GUARD
from observer.files.logs import read_log
from observer.frames import EstimateQuality
from observer.installation import load as load_config
from observer.service.observers import Keeper, Step, stored
from tests.patience import PATIENCE_S

ROOT = Path(__file__).parents[2]
RIG = ROOT / "tests" / "data" / "rig"


@pytest.fixture(scope="module")
def machine() -> MachineModel:
    config = load_config(RIG / "config.toml")
    return MachineModel.of(config)


@pytest.fixture(scope="module")
def rig(machine):
    """Some minutes of the shipped log, and where the pipeline stood after them."""
    estimator = machine.estimator()
    pipeline = machine.pipeline(estimator)
    log = read_log(RIG / "run_c.csv.gz", machine.config.channels)
    log = replace(log, time_s=log.time_s[:4000] + 1.8e9, values=log.values[:4000])
    blocks = list(frames_of_log(log, machine.plan, 2000))
    first = pipeline.step(blocks[0])
    snapshot = Snapshot(float(first.time_s[-1]), *pipeline.snapshot())
    return estimator, snapshot, log, first, pipeline.step(blocks[1])


@pytest.fixture(scope="module")
def fit(machine) -> CheckpointFit:
    return CheckpointFit.of(machine)


def _assert_same(one, other) -> None:
    assert type(one) is type(other)
    if is_dataclass(one):
        for field in fields(one):
            _assert_same(getattr(one, field.name), getattr(other, field.name))
    elif isinstance(one, np.ndarray):
        assert (one.dtype, one.shape, one.tobytes()) == (other.dtype, other.shape, other.tobytes())
    elif isinstance(one, tuple):
        assert len(one) == len(other)
        for a, b in zip(one, other, strict=True):
            _assert_same(a, b)
    else:
        np.testing.assert_equal(one, other)


def test_every_bit_comes_back(rig, fit):
    _assert_same(unpack(pack(rig[1], fit), fit), rig[1])


def test_a_restored_pipeline_continues_to_the_last_bit(machine, rig, fit):
    """What a replay does with the file beside a recording."""
    estimator, snapshot, log, _, second = rig
    rest = replace(log, time_s=log.time_s[2000:], values=log.values[2000:])
    pipeline, begun = machine.pipeline(estimator), unpack(pack(snapshot, fit), fit)
    again = [b for _, b in estimates_of(rest, machine.plan, pipeline, lambda *_: None, begun)]
    assert np.concatenate([b.heat_W for b in again]).tobytes() == second.heat_W.tobytes()
    assert np.concatenate([b.field_sigma_K for b in again]).tobytes() == second.field_sigma_K.tobytes()


@pytest.mark.parametrize("minutes", [15, 25, 65, 102])
def test_a_gap_of_ten_seconds_is_predicted_over(machine, minutes):
    """The heats move by less than a standard deviation, which grows with the gap (docs/how-to/operate.md)."""
    estimator = machine.estimator()
    pipeline = machine.pipeline(estimator)
    log, rows = read_log(RIG / "run_c.csv.gz", machine.config.channels), 120 * minutes  # two rows a second
    before = replace(log, time_s=log.time_s[:rows], values=log.values[:rows])
    for frames in frames_of_log(before, machine.plan):
        last = pipeline.step(frames)
    snapshot = Snapshot(float(last.time_s[-1]), *pipeline.snapshot())
    later = slice(rows + 19, rows + 60)
    after = replace(log, time_s=log.time_s[later], values=log.values[later])
    again = machine.pipeline(estimator)
    _, first = next(iter(estimates_of(after, machine.plan, again, lambda *_: None, snapshot)))
    assert first.time_s[0] - last.time_s[-1] == 10.0
    assert first.quality[0] == EstimateQuality.GOOD
    assert (np.abs(first.heat_W[0] - last.heat_W[-1]) < 0.6 * first.heat_sigma_W[0]).all()
    grown = first.heat_sigma_W[0] / last.heat_sigma_W[-1]
    assert (grown > 1.0).all()
    assert grown.max() < 1.14  # and not as after a cold start


def test_moments_move_and_durations_do_not(rig):
    snapshot = rig[1]
    moved = shifted(snapshot, 3600.0)
    assert moved.tick_s == snapshot.tick_s + 3600.0
    assert moved.estimator.time_s == snapshot.estimator.time_s + 3600.0
    assert moved.drive.begin_s == snapshot.drive.begin_s + 3600.0
    assert moved.drive.nuts[0].path["time_s"] == snapshot.drive.nuts[0].path["time_s"] + 3600.0
    assert moved.drive.nuts[0].weight_s == snapshot.drive.nuts[0].weight_s
    np.testing.assert_array_equal(moved.drive.running_s, snapshot.drive.running_s)
    _assert_same(shifted(moved, -3600.0).drive.nuts[0].B, snapshot.drive.nuts[0].B)


def test_the_onsets_of_findings_move_with_the_clock(rig):
    """So that "since 14:03" is a time of the clock that people see."""
    snapshot = rig[1]
    guard, verdict = np.zeros(2, SENSOR_GUARD), np.zeros(1, SCREENING_VERDICT)
    estimator = replace(snapshot.estimator, guard=guard, verdict=verdict)
    moved = shifted(replace(snapshot, estimator=estimator), 3600.0).estimator
    later = [name for name in SENSOR_GUARD.names if moved.guard[name].any()]
    later += [name for name in SCREENING_VERDICT.names if moved.verdict[name].any()]
    assert later == ["first_out_s", "latched_s", "common_from_s", "held_from_s", "held_until_s"]
    assert set(moved.guard["first_out_s"]) == {3600.0}


def test_a_number_that_is_remembered_under_another_name_is_refused(rig, fit):
    data = pack(rig[1], fit)
    document = cbor2.loads(data[64:])
    verdict = document["estimator"]["verdict"]
    verdict["another_s"] = verdict.pop("hold_s")
    body = cbor2.dumps(document)
    with pytest.raises(UnfitError, match=r"its estimator\.verdict does not fit this model"):
        unpack(data[:32] + hashlib.sha256(body).digest() + body, fit)


def test_says_what_does_not_fit(rig, fit):
    data = pack(rig[1], fit)
    with pytest.raises(UnfitError, match="another configuration"):
        unpack(data, replace(fit, plant="other"))
    with pytest.raises(UnfitError, match=r"its estimator.* does not fit"):
        unpack(data, replace(fit, estimator=replace(fit.estimator, x_hat=np.zeros(3))))
    with pytest.raises(UnfitError, match="its drive does not fit"):
        unpack(data, replace(fit, drive=0.0))
    broken = replace(rig[1], estimator=replace(rig[1].estimator, P=fit.estimator.P * math.nan))
    with pytest.raises(UnfitError, match="not finite"):
        unpack(pack(broken, fit), fit)


def test_is_of_one_version_of_the_program(rig, fit, monkeypatch):
    data = pack(rig[1], fit)
    monkeypatch.setattr(checkpoint, "version", lambda _: "99.0")
    with pytest.raises(UnfitError, match="by version 0"):
        unpack(data, fit)


def test_has_its_time(rig):
    now_s = rig[1].tick_s
    assert recent(rig[1], now_s + 60.0, 900.0) is rig[1]
    with pytest.raises(UnfitError, match="901 s old, more than 900 s"):
        recent(rig[1], now_s + 901.0, 900.0)
    with pytest.raises(UnfitError, match="ahead of the computer's clock"):
        recent(rig[1], now_s - 3600.0, 900.0)


def test_a_damaged_file_is_reported_and_does_no_harm(tmp_path, rig, fit):
    data = pack(rig[1], fit)
    path = tmp_path / "m-x.checkpoint"
    for cut in (0, 10, 40, 100, len(data) - 1):
        path.write_bytes(data[:cut])
        assert stored(path, fit, rig[1].tick_s + 1.0, 900.0) == (None, None, None)
    for place in range(0, len(data), 97):
        path.write_bytes(data[:place] + bytes([data[place] ^ 4]) + data[place + 1 :])
        assert stored(path, fit, rig[1].tick_s + 1.0, 900.0) == (None, None, None)
    for nothing_of_it in (b"no checkpoint at all", bytes(100_000)):
        path.write_bytes(nothing_of_it)
        assert stored(path, fit, rig[1].tick_s + 1.0, 900.0) == (None, None, None)
    path.unlink()
    assert stored(path, fit, rig[1].tick_s + 1.0, 900.0) == (None, None, None)
    path.mkdir()
    assert stored(path, fit, rig[1].tick_s + 1.0, 900.0) == (None, None, None)


_documents = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text() | st.binary(max_size=40),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=8), inner, max_size=4),
    max_leaves=12,
)


@given(_documents, st.sampled_from(["drive", "estimator", "compensation", "tick_s", "whole"]))
@example(-(2**63) - 1, "tick_s")
@settings(max_examples=200)
def test_any_invalid_content_is_reported(rig, fit, document, where):
    """The checksum may be right and the content still anything."""
    head, body = pack(rig[1], fit)[:64], pack(rig[1], fit)[64:]
    whole = cbor2.loads(body) | ({} if where == "whole" else {where: document})
    body = cbor2.dumps(document if where == "whole" else whole)
    with_compensation = replace(
        fit, compensation=compensation.CompensationState("", 0.0, np.ones(3), np.ones(2))
    )
    try:
        unpack(head[:32] + hashlib.sha256(body).digest() + body, with_compensation)
    except UnfitError:
        return
    assert where in {"compensation", "tick_s"} or document == whole.get(where)


def test_a_checkpoint_says_that_a_compensation_was_armed_whatever_its_setup_is_now(rig, fit):
    held = compensation.CompensationState(None, 5.0, np.array([1.0, -2.0]), np.array([0.5, 1.5]), True)
    like = replace(held, reason="not armed yet", table_um=np.zeros(2), ends_um=np.zeros(2))
    fit = replace(fit, setup="a", compensation=like)
    data = pack(replace(rig[1], compensation=held), fit)
    again = unpack(data, fit).compensation
    assert again.armed
    np.testing.assert_array_equal(again.table_um, held.table_um)
    np.testing.assert_array_equal(again.ends_um, held.ends_um)
    other = unpack(data, replace(fit, setup="b")).compensation
    assert other.armed
    np.testing.assert_array_equal(other.table_um, 0.0)  # its table is that of another setup
    older = cbor2.loads(data[64:])
    del older["compensation"]["state"]["released_s"]  # as an earlier version wrote it
    body = cbor2.dumps(older)
    earlier = unpack(data[:32] + hashlib.sha256(body).digest() + body, fit).compensation
    assert math.isnan(earlier.released_s)


def test_where_the_machine_was_set_to_zero_outlives_age_and_another_setup(tmp_path, rig, fit):
    cold = compensation.CompensationState("not armed yet", math.nan, np.zeros(2), np.zeros(2))
    zero = ZeroPoint(5.0, 0.3, 21.0, 0.5, 3.0, "anna@desk")
    fit = replace(fit, setup="a", compensation=cold)
    data = pack(replace(rig[1], compensation=replace(cold, table_um=np.ones(2), zero=zero)), fit)
    assert unpack(data, fit).compensation.zero == zero
    other = unpack(data, replace(fit, setup="b")).compensation
    assert not other.armed
    assert other.zero == zero
    np.testing.assert_array_equal(other.table_um, 0.0)
    path = tmp_path / "m-x.checkpoint"
    path.write_bytes(data)
    snapshot, _, earlier = stored(path, fit, rig[1].tick_s + 1e6, 900.0)
    assert (snapshot, earlier.zero) == (None, zero)
    later = shifted(unpack(data, fit), 7.0).compensation
    assert later.zero == replace(zero, time_s=12.0)


def test_the_keeper_writes_the_newest_whole_and_for_its_owner_only(tmp_path, rig, fit):
    path = tmp_path / "new" / "m-x.checkpoint"
    keeper = Keeper(path, fit, 10.0)
    standings = [replace(rig[1], tick_s=float(k)) for k in range(100)]
    for k, snapshot in enumerate(standings):
        keeper.follow(Step(None, None, None, now_s=float(k), snapshot=lambda snapshot=snapshot: snapshot))
    keeper.finish(replace(rig[1], tick_s=1234.0))
    assert keeper.finished(PATIENCE_S) is None
    assert load(path, fit).tick_s == 1234.0
    assert stat.S_IMODE(path.stat().st_mode) == 0o600
    assert [p.name for p in path.parent.iterdir()] == ["m-x.checkpoint"]


def test_the_keeper_says_when_it_cannot_write(tmp_path, rig, fit):
    (tmp_path / "new").write_text("a file where the folder should be")
    keeper = Keeper(tmp_path / "new" / "m-x.checkpoint", fit, 10.0)
    keeper.finish(rig[1])
    assert keeper.finished(PATIENCE_S) is None
    assert "cannot be written" in keeper.notices()[0]


@pytest.mark.parametrize(
    ("checkpoint", "record", "place"),
    [
        (Checkpoint(), RecordSettings(), "/state"),
        (Checkpoint(), RecordSettings(directory=Path("/recordings")), "/recordings"),
        (Checkpoint(directory=Path("/own")), RecordSettings(directory=Path("/recordings")), "/own"),
        (Checkpoint(enabled=False), RecordSettings(directory=Path("/recordings")), None),
    ],
)
def test_where_it_lies(monkeypatch, checkpoint, record, place):
    monkeypatch.setenv(STATE_DIRECTORY, "/state:/other")
    assert checkpoint.place(record) == (None if place is None else Path(place))
    monkeypatch.delenv(STATE_DIRECTORY)
    assert Checkpoint().place(RecordSettings()) is None


def test_what_lies_beside_the_model_does_not_matter(machine):
    config = machine.config
    moved = config.model_copy(
        update={"record": RecordSettings(directory=Path(os.sep)), "publish": config.publish}
    )
    assert moved.plant_digest == config.plant_digest
    other = config.model_copy(update={"screw": config.screw.model_copy(update={"length_m": 2.0})})
    assert other.plant_digest != config.plant_digest
