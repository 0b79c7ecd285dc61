"""What the past gives is what was published, to the last bit; what is different, it says."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest

from observer.bus.codec import decode, decode_estimate
from observer.errors import ConfigError, LogError
from observer.record.pages import LONGEST_S, Pages, Span, time_of
from observer.record.retention import CONFIG_SUFFIX, START_SUFFIX, STATE_SUFFIX, Retention, tidy
from observer.record.step_columns import StepRows
from observer.record.step_files import StepAppender, pack, pack_closed, step_files
from observer.record.step_store import Past
from observer.service.past_tending import tend
from tests.record.lived import BEGIN_S, PERIOD_S, configuration, lived

NAME = "demo-x"
HOUR_S = 3600.0 * math.ceil(BEGIN_S / 3600.0)
"""An hour that begins some minutes after `BEGIN_S`."""


def _estimates(pages: Pages, from_s: float, to_s: float) -> tuple[list, list[dict]]:
    """All pages of a span: the estimates, and what each page says of itself."""
    estimates, heads, at_s = [], [], from_s
    while at_s is not None:
        page = decode(pages.estimates(Span(at_s, to_s)))
        estimates += page.pop("estimates")
        heads.append(page)
        at_s = page["next"]
    return estimates, heads


def _assert_same(estimates: list[dict], published: list[bytes]) -> None:
    assert [e["time_s"] for e in estimates] == [decode_estimate(p)["time_s"] for p in published]
    for one, other in zip(estimates, map(decode_estimate, published), strict=True):
        assert one.keys() == other.keys()
        for key, value in other.items():
            np.testing.assert_array_equal(one[key], value, err_msg=key)


def _in(published: list[bytes], from_s: float, to_s: float) -> list[bytes]:
    return [p for p in published if from_s <= decode_estimate(p)["time_s"] < to_s]


def _pages(folder, config) -> Pages:
    return Pages(Past(folder, NAME), config.digest)


@pytest.fixture(scope="module", params=["rows", "packed"])
def shift(request, tmp_path_factory):
    """Ten minutes across a full hour, in files of rows or packed."""
    folder = tmp_path_factory.mktemp("shift")
    config = configuration(folder)
    estimates, readings, _ = lived(config, 1200, begin_s=HOUR_S - 300.0)
    if request.param == "packed":
        pack_closed(folder, NAME)
    ends = {".parquet"} if request.param == "packed" else {".steps"}
    assert [file.path.suffix for file in step_files(folder, NAME)] == [*ends] * 2
    return config, folder, estimates, readings


@pytest.mark.parametrize(("first", "last"), [(0, 1200), (130, 131), (590, 900), (1190, 5000), (-50, 3)])
def test_what_was_published_comes_back_to_the_last_bit(shift, first, last):
    config, folder, estimates, readings = shift
    from_s, to_s = HOUR_S - 300.0 + first * PERIOD_S, HOUR_S - 300.0 + last * PERIOD_S
    found, heads = _estimates(_pages(folder, config), from_s, to_s)
    _assert_same(found, _in(estimates, from_s, to_s))
    assert {(h["config"], h["estimated_with"], h["in_force"]) for h in heads} == {(config.digest,) * 3}
    assert [note for head in heads for note in head["notes"]] == []
    page = json.loads(_pages(folder, config).readings(Span(from_s, to_s)))
    assert page["readings"] == [json.loads(r) for r in readings if from_s <= json.loads(r)["time_s"] < to_s]


def test_pieces_of_the_past_can_be_read_backwards(shift):
    _, folder, estimates, _ = shift
    pieces = list(Past(folder, NAME).read(-math.inf, math.inf, [], backwards=True))
    time_s = np.concatenate([piece.time_s[::-1] for piece in pieces])
    np.testing.assert_array_equal(time_s, [decode_estimate(p)["time_s"] for p in estimates[::-1]])


def test_columns_have_the_names_of_estimates_csv_and_of_channels(shift):
    config, folder, estimates, readings = shift
    channel = config.sensor[1].channel
    columns = Past(folder, NAME).columns(["heat_nut_W", channel, "nothing"], HOUR_S - 300.0, HOUR_S + 300.0)
    published = [decode_estimate(p) for p in estimates]
    nut = published[0]["sources"].index("nut")
    np.testing.assert_array_equal(columns["heat_nut_W"], [e["heat_W"][nut] for e in published])
    np.testing.assert_allclose(
        columns[channel], [json.loads(r)["channels"][channel]["value"] for r in readings], atol=1e-6
    )  # a message has six digits
    assert np.isnan(columns["nothing"]).all()
    assert columns["time_s"][0] == HOUR_S - 300.0


def test_a_span_with_an_interval_gives_one_step_of_each(shift):
    config, folder, _, _ = shift
    page = decode(_pages(folder, config).estimates(Span(HOUR_S - 299.0, HOUR_S - 100.0, 60.0)))
    times_s = [estimate["time_s"] for estimate in page["estimates"]]
    np.testing.assert_array_equal(times_s, HOUR_S - np.array([240.0, 180.0, 120.0]))


def test_a_page_has_an_end_and_says_where_to_go_on(shift, monkeypatch):
    config, folder, estimates, _ = shift
    monkeypatch.setattr("observer.record.pages._MOST_BYTES", 100_000)
    found, heads = _estimates(_pages(folder, config), HOUR_S - 300.0, HOUR_S + 300.0)
    _assert_same(found, estimates)
    assert len(heads) > 5
    (page, *_), early_s = heads, HOUR_S - 9300.0
    long = decode(_pages(folder, config).estimates(Span(early_s, HOUR_S - 300.0)))
    assert page["to_s"] == page["next"]
    assert long["next"] == early_s + LONGEST_S
    assert long["gaps_s"] == [[early_s, long["next"]]]


def test_late_messages_are_the_published_ones_with_a_mark(shift):
    config, folder, estimates, readings = shift
    page = _pages(folder, config).late(Span(HOUR_S, HOUR_S + 1.0), ["estimate", "readings", "heat", "error"])
    assert [time_s for time_s, _ in page.steps] == [HOUR_S, HOUR_S + 0.5]
    messages = page.steps[0][1]
    estimate = decode_estimate(messages["estimate"])
    assert estimate.pop("late") is True
    _assert_same([estimate], _in(estimates, HOUR_S, HOUR_S + 0.5))
    assert json.loads(messages["readings"]) == json.loads(readings[600]) | {"late": True}
    heat = json.loads(messages["heat"])
    nut = estimate["sources"].index("nut")
    assert heat["sources"]["nut"]["heat_W"] == pytest.approx(float(estimate["heat_W"][nut]), abs=1e-6)


def test_restarts_gaps_and_other_configurations_are_reported_and_never_mixed(tmp_path):
    config = configuration(tmp_path)
    other = configuration(tmp_path, surface=config.surface.model_copy(update={"convection_W_m2K": 33.0}))
    first, _, standing = lived(config, 200)
    second, _, _ = lived(config, 200, begin_s=BEGIN_S + 150.0, instance="00000002", start=standing)
    third, _, _ = lived(other, 200, begin_s=BEGIN_S + 260.0, instance="00000003")
    found, heads = _estimates(_pages(tmp_path, other), BEGIN_S, BEGIN_S + 400.0)
    _assert_same(found, first + second + third)
    assert [head["config"] for head in heads] == [config.digest, other.digest]
    assert all(head["in_force"] == other.digest for head in heads)
    assert heads[0]["gaps_s"][0] == [BEGIN_S + 99.5, BEGIN_S + 150.0]


def test_steps_that_a_crash_has_lost_are_made_again_from_the_readings(tmp_path):
    """A service was killed: its last rows are missing, and the one before them is cut."""
    config = configuration(tmp_path)
    estimates, _, _ = lived(config, 600, rotate_bytes=20_000)
    (file,) = tmp_path.glob("*.steps")
    size = file.stat().st_size
    with file.open("r+b") as opened:
        opened.truncate(size - 40_000)
    before, _ = _estimates(_pages(tmp_path, config), BEGIN_S, BEGIN_S + 300.0)
    assert 0 < len(before) < 600
    tend(tmp_path, NAME)
    found, heads = _estimates(_pages(tmp_path, config), BEGIN_S, BEGIN_S + 300.0)
    _assert_same(found, estimates)
    assert [note for head in heads for note in head["notes"]] == []
    files = sorted(tmp_path.iterdir())
    assert not list(tmp_path.glob("*.steps"))
    tend(tmp_path, NAME)  # there is nothing left to do
    assert sorted(tmp_path.iterdir()) == files


def test_recordings_of_a_service_that_kept_no_steps_give_them(tmp_path):
    config = configuration(tmp_path)
    estimates, _, standing = lived(config, 200, keeps_steps=False)
    more, _, _ = lived(config, 100, begin_s=BEGIN_S + 150.0, start=standing, instance="00000002")
    tend(tmp_path, NAME)
    found, _ = _estimates(_pages(tmp_path, config), BEGIN_S, BEGIN_S + 400.0)
    _assert_same(found, estimates + more)


@pytest.mark.parametrize("is_removed", [True, False])
def test_steps_that_are_not_as_published_say_so(tmp_path, is_removed):
    config = configuration(tmp_path)
    lived(config, 600, rotate_bytes=20_000, keeps_steps=False)
    for path in [*tmp_path.glob(f"*{STATE_SUFFIX}"), *tmp_path.glob(f"*{START_SUFFIX}")]:
        if is_removed:
            path.unlink()
        else:
            path.write_bytes(b"of another version")
    tend(tmp_path, NAME)
    found, heads = _estimates(_pages(tmp_path, config), BEGIN_S, BEGIN_S + 300.0)
    assert len(found) == 600
    assert any("made again, started cold" in note for head in heads for note in head["notes"])


def test_a_recording_without_its_configuration_gives_no_steps(tmp_path):
    config = configuration(tmp_path)
    lived(config, 60, keeps_steps=False)
    for path in tmp_path.glob(f"*{CONFIG_SUFFIX}"):
        path.unlink()
    tend(tmp_path, NAME)
    assert step_files(tmp_path, NAME) == []


@pytest.mark.parametrize("ending", [".steps", ".parquet"])
def test_a_damaged_file_is_left_out_with_a_sentence(tmp_path, ending):
    config = configuration(tmp_path)
    estimates, _, _ = lived(config, 1200, begin_s=HOUR_S - 300.0)
    if ending == ".parquet":
        pack_closed(tmp_path, NAME)
    first = step_files(tmp_path, NAME)[0].path
    first.write_bytes(b"{" + first.read_bytes()[1:-2] + b"xx")
    if ending == ".steps":
        first.write_bytes(b"\0" + first.read_bytes()[1:])
    found, heads = _estimates(_pages(tmp_path, config), HOUR_S - 300.0, HOUR_S + 300.0)
    _assert_same(found, estimates[600:])
    assert any(first.name in note and "left out" in note for head in heads for note in head["notes"])


def test_zeros_that_a_power_cut_left_at_the_end_are_no_steps(tmp_path):
    config = configuration(tmp_path)
    estimates, _, _ = lived(config, 60)
    (file,) = tmp_path.glob("*.steps")
    with file.open("ab") as opened:
        opened.write(bytes(5000))
    found, _ = _estimates(_pages(tmp_path, config), BEGIN_S, BEGIN_S + 60.0)
    _assert_same(found, estimates)
    pack(file)
    found, _ = _estimates(_pages(tmp_path, config), BEGIN_S, BEGIN_S + 60.0)
    _assert_same(found, estimates)


def test_a_file_that_is_being_written_is_read_and_not_packed(tmp_path):
    config = configuration(tmp_path)
    lived(config, 60)
    past = Past(tmp_path, NAME)
    (steps,) = past.read(-math.inf, math.inf, [])
    moved = StepRows(steps.source, steps.rows.copy())
    moved.rows["time_s"] += 100.0
    files = StepAppender(tmp_path, NAME, steps.source)
    assert files.append(moved.rows) == 60
    pack_closed(tmp_path, NAME)
    assert [file.is_packed for file in past.files()] == [True, False]
    assert past.span_s() == (BEGIN_S, BEGIN_S + 129.5)
    files.close()


def test_steps_are_kept_within_the_bounds_of_the_recordings(tmp_path):
    config = configuration(tmp_path)
    lived(config, 1200, begin_s=HOUR_S - 300.0)
    pack_closed(tmp_path, NAME)
    first, second = (file.path for file in step_files(tmp_path, NAME))
    gone = tidy(tmp_path, NAME, Retention(keep_s=100.0), HOUR_S + 200.0, by_age=True)
    assert (first in gone, second in gone) == (True, False)  # its age is that of its last step


@pytest.mark.parametrize(
    "text", ["1700000000", "2023-11-14T22:13:20Z", "2023-11-14T23:13:20+01:00", "2023-11-14T22:13:20"]
)
def test_a_time_is_given_in_seconds_or_by_iso_8601(text):
    assert time_of(text, "from") == 1_700_000_000.0


@pytest.mark.parametrize(
    "asked",
    [{"to": "5"}, {"from": "noon"}, {"from": "nan"}, {"from": "9", "to": "5"},
     {"from": "1", "to": "2", "every": "-1"}, {"from": "1", "to": "2", "every": "x"}],
)  # fmt: skip
def test_an_invalid_span_is_rejected_with_a_sentence(asked):
    with pytest.raises(ConfigError, match="give"):
        Span.of(asked, 10.0)


def test_a_folder_that_cannot_be_read_is_reported_and_a_missing_one_is_empty(tmp_path):
    (tmp_path / "file").touch()
    with pytest.raises(LogError, match=r"record\.directory"):
        Past(tmp_path / "file", NAME).files()
    assert Past(tmp_path / "none", NAME).files() == []
