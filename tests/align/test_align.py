"""Readings become frames: what is fresh, what is old, what is refused."""

import math
import tempfile
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from observer.align.aligner import Aligner, AlignPlan, blocks_of_log, faults_of, frames_of_log
from observer.files.logs import Log, read_log
from observer.frames import Quality, Reading
from observer.kernels.layout import state_type
from observer.kernels.walk import is_stuck
from tests.logs.machines import SCREW
from tests.logs.recordings import CHANNELS, joined, plan, play, same_bits, streams, write

GOOD, MISSING, STALE, REJECTED = Quality.GOOD, Quality.MISSING, Quality.STALE, Quality.REJECTED


def _t1(frame):
    """Value, freshness and quality of the first channel."""
    return float(frame.values[0, 0]), bool(frame.fresh[0, 0]), Quality(frame.quality[0, 0])


def test_never_seen_is_missing():
    value, fresh, quality = _t1(Aligner(plan()).tick(1.0))
    assert math.isnan(value)
    assert (fresh, quality) == (False, MISSING)


def test_a_value_is_fresh_once():
    aligner = Aligner(plan())
    aligner.ingest(Reading(0.4, {"t1_degC": 20.0}))
    aligner.ingest(Reading(0.45, {"t1_degC": 21.0}))
    assert _t1(aligner.tick(0.5)) == (21.0, True, GOOD)
    assert _t1(aligner.tick(1.0)) == (21.0, False, GOOD)


@pytest.mark.parametrize(("expected_s", "limit_s"), [(0.5, 1.0), (3.0, 6.0), (0.02, 1.0)])
def test_stale_beyond_two_periods_of_channel_or_tick(expected_s, limit_s):
    aligner = Aligner(plan(expected_s=(expected_s, 0.5, 0.5)))
    aligner.ingest(Reading(10.0, {"t1_degC": 20.0}))
    assert _t1(aligner.tick(10.0 + limit_s))[2] == GOOD
    frame = aligner.tick(10.001 + limit_s)
    assert _t1(frame) == (20.0, False, STALE)
    assert frame.age_s[0, 0] == pytest.approx(limit_s + 0.001)
    aligner.ingest(Reading(20.0, {"t1_degC": 22.0}))
    assert _t1(aligner.tick(20.0)) == (22.0, True, GOOD)


def test_an_unknown_period_is_learned_and_an_outage_does_not_teach():
    aligner = Aligner(plan(expected_s=(math.nan,) * 3))
    for time_s in [0, 2, 4, 6, 60, 62]:
        aligner.ingest(Reading(time_s, {"t1_degC": 20.0 + time_s}))
    assert _t1(aligner.tick(65.9))[2] == GOOD
    assert _t1(aligner.tick(66.1))[2] == STALE


def test_a_fault_rejects_until_the_next_good_value():
    aligner = Aligner(plan())
    aligner.ingest(Reading(0.1, {"t1_degC": 20.0}))
    aligner.ingest(Reading(0.2, {"t1_degC": math.nan}, {"t1_degC": "open_circuit"}))
    assert _t1(aligner.tick(0.5)) == (20.0, False, REJECTED)
    assert aligner.faults == {"t1_degC": "open_circuit"}
    assert _t1(aligner.tick(9.0))[2] == REJECTED
    aligner.ingest(Reading(9.1, {"t1_degC": 21.0}))
    assert _t1(aligner.tick(9.5)) == (21.0, True, GOOD)
    assert aligner.faults == {}


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_no_number_without_a_fault_is_missing(value):
    aligner = Aligner(plan())
    aligner.ingest(Reading(0.1, {"t1_degC": 20.0}))
    aligner.ingest(Reading(0.2, {"t1_degC": value}))
    assert _t1(aligner.tick(0.5)) == (20.0, False, MISSING)


def test_times_never_go_back():
    aligner = Aligner(plan())
    times = [aligner.ingest(Reading(t, {"t1_degC": 1.0})).time_s for t in (5.0, 3.0, 5.0, 6.0)]
    tick_s = aligner.tick(5.5).time_s[0]
    assert times[0] == 5.0
    assert all(b > a for a, b in zip([*times, tick_s], [*times[1:], tick_s, math.inf], strict=False))
    assert tick_s == math.nextafter(6.0, 7.0)


def test_the_first_step_has_no_length():
    aligner = Aligner(plan())
    assert [aligner.tick(t).dt_s[0] for t in (3.0, 3.5, 4.5)] == [0.0, 0.5, 1.0]


def test_a_fast_position_keeps_its_path():
    aligner = Aligner(plan())
    aligner.tick(0.0)
    for k in range(1, 6):
        aligner.ingest(Reading(0.1 * k, {"nut_position_m": 0.01 * k}))
    aligner.ingest(Reading(0.55, {"nut_position_m": math.nan}, {"nut_position_m": "timeout"}))
    times, values, offset, _, _ = aligner.tick(0.6).path["nut_position_m"]
    np.testing.assert_array_equal(values, [0.01 * k for k in range(1, 6)])
    np.testing.assert_array_equal(times, [0.1 * k for k in range(1, 6)])
    np.testing.assert_array_equal(offset, [0, 5])


def test_each_row_of_a_plain_log_is_a_frame():
    values = np.array([[20.0, np.nan, 0.1], [np.nan, 21.0, 0.2], [22.0, np.nan, np.nan]])
    log = Log(Path("x.csv"), np.array([0.0, 1.0, 7.0]), CHANNELS, values)
    (frames,) = frames_of_log(log, plan())
    np.testing.assert_array_equal(frames.dt_s, [0, 1, 6])
    np.testing.assert_array_equal(frames.quality[:, 0], [GOOD, MISSING, GOOD])
    np.testing.assert_array_equal(frames.quality[:, 1], [MISSING, GOOD, MISSING])
    np.testing.assert_array_equal(frames.fresh, np.isfinite(values))
    np.testing.assert_array_equal(frames.values[:, 1], [np.nan, 21, 21])
    np.testing.assert_array_equal(frames.path["nut_position_m"][2], [0, 1, 2, 2])


def test_a_channel_the_log_lacks_is_missing():
    log = Log(Path("x.csv"), np.array([0.0, 1.0]), ("t2_degC",), np.array([[1.0], [2.0]]))
    (frames,) = frames_of_log(log, plan())
    np.testing.assert_array_equal(frames.quality, [[MISSING, GOOD, MISSING]] * 2)


@pytest.mark.parametrize("own", [plan(), plan(expected_s=(math.nan,) * 3)], ids=["known", "learned periods"])
@given(events=streams, block=st.integers(1, 7))
@settings(max_examples=100)
def test_a_recording_gives_the_frames_of_the_live_run_to_the_last_bit(own, events, block):
    live, recording = play([*events, 0.5], Aligner(own))
    with tempfile.TemporaryDirectory() as folder:
        log = read_log(write(Path(folder), recording), CHANNELS)
    replayed = list(frames_of_log(log, own, block))
    assert all(len(frames) <= block for frames in replayed)
    assert same_bits(joined(live), joined(replayed))


def test_flags_are_read_back():
    assert faults_of(None) == {}
    assert faults_of("a=open_circuit;b%3D=x%3By") == {"a": "open_circuit", "b=": "x;y"}


def _stuck_at(values, noise_K=0.05):
    """The samples at which a series counts as stuck."""
    noise = np.zeros(1, state_type("ChannelNoise"))[0]
    noise.last = np.nan
    return [k for k, value in enumerate(values) if is_stuck(noise, float(value), noise_K)]


def test_a_noisy_sensor_that_freezes_is_stuck_until_it_changes():
    noisy = 20 + np.random.default_rng(1).normal(0, 0.05, 300)
    values = [*noisy, *([noisy[-1]] * 80), 20.1, *noisy]
    assert _stuck_at(values) == list(range(359, 380))


def test_twenty_noisy_samples_are_enough_to_know_one_that_freezes():
    """A sensor that fails soon after the start must not look good for ever; here with steps of 0.1 K."""
    found = 0
    for seed in range(200):
        noisy = np.round(20.02 + np.random.default_rng(seed).normal(0, 0.05, 20), 1)
        found += bool(_stuck_at([*noisy, *([noisy[-1]] * 80)]))
    assert found >= 198  # by chance one in a few hundred shows next to no noise in 20 samples


@pytest.mark.parametrize(
    "values",
    [
        np.full(1000, 20.0),
        np.concatenate([20 + 0.02 * np.arange(500), np.full(500, 30.0)]),
        np.round(np.concatenate([40 - 20 * np.exp(-np.arange(3000) / 300), np.full(500, 40.0)]), 2),
    ],
    ids=["constant", "ramp then constant", "rounded heating curve"],
)
def test_a_log_without_noise_is_never_stuck(values):
    assert _stuck_at(values) == []


def test_a_coarse_converter_is_known_by_its_long_repeats():
    """Noise far below the resolution repeats for long; after the first runs it is left in peace."""
    rng = np.random.default_rng(2)
    drift = 20 + 0.3 * np.sin(np.arange(40_000) / 3000)
    values = np.round((drift + rng.normal(0, 0.02, 40_000)) * 10) / 10
    assert len(_stuck_at(values)) < 0.4 * len(values)
    assert _stuck_at(values, noise_K=math.nan) == []


@pytest.mark.parametrize(("known", "limit"), [(0, 60), (15, 60), (40, 120), (199, 597), (400, 600)])
def test_a_freeze_must_last_thrice_the_longest_repeat_known(known, limit):
    """At least 60 samples, and at most 600: a sensor that froze once for hours must not freeze unseen."""
    noisy = 20 + np.random.default_rng(4).normal(0, 0.05, 100)
    before = [*noisy, *([20.0] * (known + 1)), *noisy]
    found = [k for k in _stuck_at([*before, *([noisy[-1]] * 700)]) if k >= len(before)]
    assert found[0] == len(before) + limit - 1


@pytest.mark.parametrize(("smooth", "stuck"), [(60, True), (150, False)])
def test_noise_is_remembered_for_about_64_samples(smooth, stuck):
    """1.95 noise_K fades with exp(-n/64); a third of noise_K is needed. The ramp has none."""
    noisy = 20 + np.random.default_rng(5).normal(0, 0.05, 300)
    ramp = 20 + 0.0625 * np.arange(smooth)
    assert bool(_stuck_at([*noisy, *ramp, *([ramp[-1]] * 80)])) is stuck


def test_a_stuck_sensor_is_rejected_live_and_named():
    aligner = Aligner(plan(expected_s=(0.1, 0.1, 0.1)))
    noisy = 20 + np.random.default_rng(3).normal(0, 0.05, 100)
    frames = []
    for k, value in enumerate([*noisy, *([20.0] * 70)]):
        aligner.ingest(Reading(0.1 * k, {"t1_degC": value, "t2_degC": 20.0}))
        frames.append(aligner.tick(0.1 * k))
    assert _t1(frames[-1])[1:] == (False, REJECTED)
    assert Quality(frames[-1].quality[0, 1]) == GOOD
    assert aligner.faults == {"t1_degC": "stuck"}


def test_the_plan_of_a_configuration():
    from observer.installation import parse

    config = parse(
        {
            "screw": SCREW,
            "ambient": {"channel": "ambient_degC"},
            "source": [{"name": "nut", "shape": "nut", "length_m": 0.08,
                        "position_channel": "nut_position_m"}],
            "sensor": [{"name": "t1", "channel": "t1_degC", "position_m": 0.1, "noise_K": 0.07}],
            "drivers": {"amp": {"kind": "modbus_tcp", "host": "h", "device": "wago_750_458", "period_s": 0.2,
                                "channels": {"t1_degC": 0}}},
        }
    )  # fmt: skip
    made = AlignPlan.of(config)
    assert made.channels == ("t1_degC", "nut_position_m", "ambient_degC")
    assert [p.column for p in made.positions] == [1]
    np.testing.assert_array_equal(made.expected_s, [0.2, np.nan, np.nan])
    np.testing.assert_array_equal(made.noise_K, [0.07, np.nan, np.nan])


# ---- what a plan takes from a configuration ----

FRICTION = {"efficiency": 0.9, "preload_N": 1000, "lead_m": 0.02}


def _plan_of(*sources, **more):
    from observer.installation import parse

    named = [{"name": f"nut{i}", "shape": "nut", "length_m": 0.08} | s for i, s in enumerate(sources)]
    named = [{key: value for key, value in s.items() if value is not None} for s in named]
    sensors = [{"name": "t1", "channel": "t1_degC", "position_m": 0.1}]
    table = {"screw": SCREW, "ambient": {"temperature_degC": 20}, "source": named, "sensor": sensors}
    return AlignPlan.of(parse(table | more))


@pytest.mark.parametrize(
    ("source", "expected"),
    [
        ({"position_channel": "x_m", "lead_m": 0.01}, (-1, None)),
        ({"position_channel": "x_m", "speed_channel": "n_rpm"}, (-1, None)),
        ({"position_channel": "x_m", "speed_channel": "n_rpm", "lead_m": 0.01}, ("n_rpm", 0.01)),
        ({"position_channel": "x_m", "speed_channel": "n_rpm", "nut_friction": FRICTION}, ("n_rpm", 0.02)),
        (
            {
                "position_channel": "x_m",
                "speed_channel": "n_rpm",
                "nut_speed_channel": "m_rpm",
                "lead_m": 0.01,
                "torque_Nm": 0.3,
            },
            (-1, None),
        ),
    ],
)
def test_a_position_is_driven_by_speed_times_lead_where_both_are_known(source, expected):
    made = _plan_of(source)
    (position,) = made.positions
    speed, lead_m = expected
    assert made.channels[position.column] == "x_m"
    if speed == -1:
        assert position.speed == -1
        assert math.isnan(position.lead_m)
    else:
        assert (made.channels[position.speed], position.lead_m) == (speed, lead_m)


def test_a_position_that_two_sources_share_is_kept_once_and_by_the_one_that_knows_its_speed():
    knows, not_so = (
        {"position_channel": "x_m", "speed_channel": "n_rpm", "lead_m": 0.01},
        {"position_channel": "x_m"},
    )
    for sources in ((knows, not_so), (not_so, knows)):
        (position,) = _plan_of(*sources).positions
        assert position.lead_m == 0.01
    assert _plan_of({"shape": "point", "length_m": None, "position_m": 0.5}).positions == ()


def test_the_plan_s_period_is_the_estimator_s():
    made = _plan_of({"shape": "point", "length_m": None, "position_m": 0.5}, estimator={"period_s": 0.25})
    assert made.period_s == 0.25
    assert made.expected().period_s == 0.25


# ---- what is taken in ----


def test_a_fault_without_a_name_is_unknown_and_a_missing_value_has_none():
    aligner = Aligner(plan())
    used = aligner.ingest(Reading(0.1, {"t1_degC": 20.0, "x": 1.0}, {"t1_degC": "", "t2_degC": "missing"}))
    assert used.faults == {"t1_degC": "unknown"}
    assert set(used.values) == {"t1_degC", "t2_degC"}, "of what is no channel nothing is recorded"
    assert math.isnan(used.values["t2_degC"])
    frame = aligner.tick(0.5)
    np.testing.assert_array_equal(frame.quality, [[REJECTED, MISSING, MISSING]])
    assert aligner.faults == {"t1_degC": "unknown"}
    assert math.isnan(
        aligner.ingest(Reading(0.6, {"t1_degC": 20.0}, {"t1_degC": "missing"})).values["t1_degC"]
    )


def test_lateness_is_reported_from_a_microsecond_on():
    aligner = Aligner(plan())
    aligner.ingest(Reading(5.0, {"t1_degC": 1.0}))
    late = [aligner.ingest(Reading(5.0 - by_s, {"t1_degC": 1.0})).late_s for by_s in (0.0, 9e-7, 2e-6, 1.5)]
    assert late[:2] == [0.0, 0.0]
    assert late[2:] == pytest.approx([2e-6, 1.5], rel=1e-6)


def test_a_late_reading_is_as_old_as_its_source_says():
    aligner = Aligner(plan())
    aligner.ingest(Reading(5.0, {"t2_degC": 1.0}))
    aligner.ingest(Reading(4.6, {"t1_degC": 20.0}))
    assert aligner.tick(5.2).age_s[0, :2] == pytest.approx([0.6, 0.2])


def test_a_warm_start_continues_from_the_last_tick():
    assert Aligner(plan(), last_tick_s=2.0).tick(3.0).dt_s[0] == 1.0
    values = np.full((2, 3), 20.0)
    log = Log(Path("x.csv"), np.array([3.0, 3.5]), CHANNELS, values)
    (frames,) = frames_of_log(log, plan(), last_tick_s=2.0)
    np.testing.assert_array_equal(frames.dt_s, [1.0, 0.5])


def test_a_value_beyond_its_limits_is_reported_with_the_current_ambient():
    from dataclasses import replace

    limits = replace(plan().limits, above_K=np.array([30.0, math.inf, math.inf]), ambient=1)
    aligner = Aligner(replace(plan(), limits=limits))
    aligner.ingest(Reading(0.1, {"t2_degC": 21.5}))
    aligner.ingest(Reading(0.2, {"t1_degC": 60.0}))
    assert Quality(aligner.tick(0.5).quality[0, 0]) == REJECTED
    assert "21.5" in aligner.faults["t1_degC"]
    fixed = Aligner(replace(plan(), limits=replace(limits, ambient=-1, ambient_degC=19.25)))
    fixed.ingest(Reading(0.2, {"t1_degC": 60.0}))
    fixed.tick(0.5)
    assert "19.2" in fixed.faults["t1_degC"]


# ---- recordings ----


def _recorded(*rows):
    """A recording from rows (time, is it a tick, flags, values by channel, late)."""
    values = np.full((len(rows), 3), np.nan)
    for k, row in enumerate(rows):
        for name, value in row[3].items():
            values[k, CHANNELS.index(name)] = value
    return Log(
        Path("r.csv"), np.array([row[0] for row in rows]), CHANNELS, values,
        step=np.array([row[1] for row in rows]), flags=[row[2] for row in rows],
        late_s=np.array([row[4] if len(row) > 4 else math.nan for row in rows]),
    )  # fmt: skip


def test_a_recording_has_its_faults_commands_and_lateness():
    log = _recorded(
        (0.1, False, "t2_degC=open_circuit;elsewhere=timeout", {"t1_degC": 20.0, "t2_degC": 5.0}, 0.3),
        (0.5, True, None, {}),
        (0.6, False, "t1_degC=missing", {}),
        (0.7, False, "!arm=done", {"nut_position_m": 0.2}),
        (1.0, True, None, {}),
    )
    (frames,) = frames_of_log(log, plan())
    np.testing.assert_array_equal(frames.quality, [[GOOD, REJECTED, MISSING], [MISSING, REJECTED, GOOD]])
    assert frames.age_s[0, 0] == pytest.approx(0.7)


@pytest.mark.parametrize("block", [1, 2, 3, 100])
def test_a_reset_begins_a_block_of_its_own(block):
    rows = [(0.5 * k + 0.5, True, "!reset=done" if k == 5 else None, {}) for k in range(6)]
    rows.insert(3, (1.7, False, "!reset=done", {}))
    rows.insert(1, (0.7, False, "!reset=refused", {}))
    found = list(blocks_of_log(_recorded(*rows), plan(), block))
    assert all(len(frames) <= block for frames, _ in found)
    np.testing.assert_array_equal(
        np.concatenate([f.time_s for f, _ in found]), [0.5, 1.0, 1.5, 2.0, 2.5, 3.0]
    )
    assert [f.time_s[0] for f, afresh in found if afresh] == [2.0, 3.0]


def test_a_log_of_channels_in_another_order_is_read_by_their_names():
    log = Log(
        Path("x.csv"), np.array([0.0]), ("nut_position_m", "extra", "t1_degC"), np.array([[0.3, 9.0, 21.0]])
    )
    (frames,) = frames_of_log(log, plan())
    np.testing.assert_array_equal(frames.values, [[21.0, np.nan, 0.3]])
    np.testing.assert_array_equal(frames.quality, [[GOOD, MISSING, GOOD]])
