"""What the archive gives is what was published, to the last bit; and what it is not, it says."""

from __future__ import annotations

import json
import math
from contextlib import suppress
from itertools import count

import numpy as np
import pytest

from observer.archive.pages import LONGEST_S, Pages, Span, time_of
from observer.archive.store import Archive, UnfinishedError
from observer.errors import ConfigError, LogError
from observer.publish.codec import decode, decode_estimate
from observer.record.recorder import Recorder
from observer.record.retention import CONFIG_SUFFIX, STATE_SUFFIX
from tests.archive.lived import BEGIN_S, PERIOD_S, configuration, lived
from tests.patience import until


def _estimates(pages: Pages, from_s: float, to_s: float) -> tuple[list, list[dict]]:
    """All pages of a span: the estimates, and what each page says of itself."""
    found, heads, at_s = [], [], from_s
    while at_s is not None:
        page = decode(pages.estimates(Span(at_s, to_s)))
        found += page.pop("estimates")
        heads.append(page)
        at_s = page["next"]
    return found, heads


def _assert_same(found: list[dict], published: list[bytes]) -> None:
    assert [e["time_s"] for e in found] == [decode_estimate(p)["time_s"] for p in published]
    for one, other in zip(found, map(decode_estimate, published), strict=True):
        assert one.keys() == other.keys()
        for key, value in other.items():
            np.testing.assert_array_equal(one[key], value, err_msg=key)


def _in(published: list[bytes], from_s: float, to_s: float) -> list[bytes]:
    return [p for p in published if from_s <= decode_estimate(p)["time_s"] < to_s]


def _all(folder, config) -> Pages:
    return Pages(Archive(config, config.digest))


@pytest.fixture(scope="module")
def month(tmp_path_factory):
    """A recording in many files, in the midst of which the estimator was reset."""
    folder = tmp_path_factory.mktemp("month")
    config = configuration(folder)
    write_tick, ticks = Recorder.tick, count()

    def tick_in_small_blocks(recorder: Recorder, *arguments: object) -> None:
        write_tick(recorder, *arguments)
        if next(ticks) % 10 == 0:  # rows that come later are in another block, however late the thread is
            until(lambda: not recorder._queue)

    with pytest.MonkeyPatch.context() as patch:  # many blocks, as those of hours
        patch.setattr("observer.record.recorder._BATCH_S", 0.002)
        patch.setattr(Recorder, "tick", tick_in_small_blocks)
        estimates, readings, _ = lived(config, 1200, rotate_bytes=20_000, resets=(700,))
    assert len(list(folder.glob("*.csv"))) > 5
    return config, estimates, readings


@pytest.mark.parametrize(("first", "last"), [(0, 1200), (130, 131), (600, 900), (1190, 5000), (-50, 3)])
def test_what_was_published_comes_back_to_the_last_bit(month, first, last):
    config, estimates, readings = month
    from_s, to_s = BEGIN_S + first * PERIOD_S, BEGIN_S + last * PERIOD_S
    found, heads = _estimates(_all(None, config), from_s, to_s)
    _assert_same(found, _in(estimates, from_s, to_s))
    assert {(h["config"], h["estimated_with"], h["in_force"]) for h in heads} == {(config.digest,) * 3}
    assert [note for head in heads for note in head["notes"]] == []
    page = json.loads(_all(None, config).readings(Span(from_s, to_s)))
    assert page["readings"] == [json.loads(r) for r in readings if from_s <= json.loads(r)["time_s"] < to_s]


def test_another_query_continues_from_a_state_of_the_replay(month, monkeypatch):
    config, estimates, _ = month
    monkeypatch.setattr("observer.archive.parts._PART_BYTES", 3000)
    pages = _all(None, config)
    whole, _ = _estimates(pages, BEGIN_S, BEGIN_S + 600.0)
    _assert_same(whole, estimates)
    for first in (1100, 20, 705, 333):
        from_s = BEGIN_S + first * PERIOD_S
        found, _ = _estimates(pages, from_s, from_s + 30.0)
        _assert_same(found, _in(estimates, from_s, from_s + 30.0))


def test_a_query_that_takes_too_long_is_rejected_and_completes_when_repeated(month, monkeypatch):
    config, _, _ = month
    monkeypatch.setattr("observer.archive.parts._PART_BYTES", 3000)
    archive = Archive(config, config.digest, clock=lambda: 1.0)
    last = sorted(archive.files(), key=lambda file: file.to_s - file.from_s)[-1]

    def found() -> bool:
        return bool(list(archive.read(last.to_s - 1.0, last.to_s, [], until_s=0.0)))

    with pytest.raises(UnfinishedError, match="ask again"):
        found()
    for _ in range(20):
        with suppress(UnfinishedError):
            if found():
                return
    raise AssertionError("asking again does not go on")


def test_one_step_of_each_interval(month):
    config, _, _ = month
    page = decode(_all(None, config).estimates(Span(BEGIN_S + 1.0, BEGIN_S + 200.0, 60.0)))
    times_s = [estimate["time_s"] for estimate in page["estimates"]]
    first = 60.0 * math.ceil((BEGIN_S + 1.0) / 60.0)
    np.testing.assert_array_equal(times_s, [t for t in first + 60.0 * np.arange(4) if t < BEGIN_S + 200.0])


def test_a_page_has_an_end_and_says_where_to_go_on(month, monkeypatch):
    config, estimates, _ = month
    monkeypatch.setattr("observer.archive.pages._MOST_BYTES", 100_000)
    found, heads = _estimates(_all(None, config), BEGIN_S, BEGIN_S + 600.0)
    _assert_same(found, estimates)
    assert len(heads) > 5
    (page, *_), long = heads, decode(_all(None, config).estimates(Span(BEGIN_S - 9000.0, BEGIN_S)))
    assert page["to_s"] == page["next"]
    assert long["next"] == BEGIN_S - 9000.0 + LONGEST_S
    assert long["gaps_s"] == [[BEGIN_S - 9000.0, long["next"]]]


def test_restarts_gaps_and_other_configurations_are_reported_and_never_mixed(tmp_path):
    config = configuration(tmp_path)
    other = configuration(tmp_path, surface=config.surface.model_copy(update={"convection_W_m2K": 33.0}))
    assert other.digest != config.digest
    first, _, standing = lived(config, 200)
    second, _, _ = lived(config, 200, begin_s=BEGIN_S + 150.0, instance="00000002", start=standing)
    third, _, _ = lived(other, 200, begin_s=BEGIN_S + 260.0, instance="00000003")
    found, heads = _estimates(_all(None, other), BEGIN_S, BEGIN_S + 400.0)
    _assert_same(found, first + second + third)
    assert [(h["config"], h["estimated_with"]) for h in heads] == [
        (config.digest, config.digest), (other.digest, other.digest)
    ]  # fmt: skip
    assert all(head["in_force"] == other.digest for head in heads)
    assert any(f"under configuration {config.digest}" in note for note in heads[0]["notes"])
    assert heads[0]["gaps_s"][0] == [BEGIN_S + 99.5, BEGIN_S + 150.0]


def test_a_recording_without_configuration_or_state_is_reported_and_estimated_again(tmp_path):
    config = configuration(tmp_path)
    lived(config, 600, rotate_bytes=20_000)
    for path in [*tmp_path.glob(f"*{STATE_SUFFIX}"), *tmp_path.glob(f"*{CONFIG_SUFFIX}")]:
        path.unlink()
    found, heads = _estimates(_all(None, config), BEGIN_S + 200.0, BEGIN_S + 290.0)
    assert len(found) == 180
    notes = [note for head in heads for note in head["notes"]]
    assert any("its configuration was not kept" in note for note in notes)
    assert any("estimates start cold" in note for note in notes)
    assert any("sequence numbers start again" in note for note in notes)
    assert heads[0]["config"] is None


def test_a_damaged_block_and_a_missing_file_are_reported(tmp_path):
    config = configuration(tmp_path)
    estimates, _, _ = lived(config, 600, rotate_bytes=20_000)
    files = sorted(
        tmp_path.glob("*.csv"), key=lambda path: float(path.read_text().split("\n")[1].split(",")[0])
    )
    data = bytearray(files[1].read_bytes())
    data[len(data) // 2] ^= 1
    files[1].write_bytes(data)
    files[2].unlink()
    pages = _all(None, config)
    found, heads = _estimates(pages, BEGIN_S, BEGIN_S + 300.0)
    assert any("damaged rows are left out" in note for head in heads for note in head["notes"])
    assert any(to_s - from_s > 5.0 for head in heads for from_s, to_s in head["gaps_s"])
    late = [p for p in estimates if decode_estimate(p)["time_s"] > BEGIN_S + 250.0]
    _assert_same(found[-len(late) :], late)


def test_a_recording_that_is_being_written_is_read_as_far_as_it_is_whole(tmp_path):
    config = configuration(tmp_path)
    estimates, _, _ = lived(config, 100)
    (file,) = tmp_path.glob("*.csv")
    with file.open("ab") as opened:
        opened.write(b"1700000049.9,22.0,2")
    found, _ = _estimates(_all(None, config), BEGIN_S, BEGIN_S + 100.0)
    _assert_same(found, estimates)


def test_times_are_seconds_or_iso_8601():
    assert time_of("1700000000.5", "from") == 1_700_000_000.5
    assert time_of("2023-11-14T22:13:20Z", "from") == 1_700_000_000.0
    assert time_of("2023-11-14T23:13:20+01:00", "from") == 1_700_000_000.0
    assert time_of("2023-11-14T22:13:20", "from") == 1_700_000_000.0


@pytest.mark.parametrize(
    "asked",
    [{"to": "5"}, {"from": "noon"}, {"from": "nan"}, {"from": "9", "to": "5"},
     {"from": "1", "to": "2", "every": "-1"}, {"from": "1", "to": "2", "every": "x"}],
)  # fmt: skip
def test_an_invalid_span_is_rejected_with_a_sentence(asked):
    with pytest.raises(ConfigError, match="give"):
        Span.of(asked, 10.0)


def test_without_recordings_nothing_is_found_in_words():
    config = configuration(None)
    with pytest.raises(LogError, match=r"record\.directory"):
        Archive(config, "").files()


def test_a_changed_digit_in_the_kept_configuration_is_an_error_and_never_estimated_with(tmp_path):
    config = configuration(tmp_path)
    other = configuration(tmp_path, surface=config.surface.model_copy(update={"convection_W_m2K": 33.0}))
    lived(config, 60)
    (path,) = tmp_path.glob(f"*{CONFIG_SUFFIX}")
    whole = path.read_text()
    places = [place for place, letter in enumerate(whole) if letter.isdigit()]
    dice = np.random.default_rng(1)
    for place in dice.choice(places, 40, replace=False):
        changed = str((int(whole[place]) + int(dice.integers(1, 10))) % 10)
        path.write_text(whole[:place] + changed + whole[place + 1 :])
        page = decode(_all(None, other).estimates(Span(BEGIN_S, BEGIN_S + 30.0)))
        if page["estimates"]:  # the same number, written otherwise
            assert json.loads(path.read_text()) == json.loads(whole)
        else:
            assert "is damaged" in page["notes"][0]
    path.write_text(whole)
    assert len(decode(_all(None, other).estimates(Span(BEGIN_S, BEGIN_S + 30.0)))["estimates"]) == 60


@pytest.mark.parametrize("place", [0.5, 1.0])
def test_a_line_of_200_MB_is_left_out_with_a_sentence(tmp_path, place):
    config = configuration(tmp_path)
    estimates, _, _ = lived(config, 400)
    (file,) = tmp_path.glob("*.csv")
    rows = file.read_bytes().splitlines(keepends=True)
    half = int(place * len(rows))
    with file.open("wb") as opened:
        opened.writelines(rows[:half])
        for _ in range(200):
            opened.write(b"1" * 1_000_000)
        opened.write(b",7,7\n")
        opened.writelines(rows[half:])
    found, heads = _estimates(_all(None, config), BEGIN_S, BEGIN_S + 400.0)
    notes = [note for head in heads for note in head["notes"]]
    assert any("a line of more than 16 MB" in note for note in notes)
    assert {e["time_s"] for e in found} <= {decode_estimate(p)["time_s"] for p in estimates}
