"""What is believed of each kind of channel, and the units that wrong values look like."""

import math
from pathlib import Path

import numpy as np
import pytest

from observer.align.aligner import Aligner, AlignPlan, frames_of_log
from observer.align.plausibility import (
    Breach,
    ChannelKind,
    Limits,
    doubts_of_log,
    implausible,
    motion_sentence,
    unit_hint,
)
from observer.align.unit_errors import in_configured_units
from observer.config.machine import ConfigError
from observer.files.logs import Log
from observer.frames import Quality, Reading
from observer.installation import load, parse
from tests.reference import live

CONFIG = Path(__file__).parents[2] / "config"


def table(**limits):
    made = live.demo().model_dump(mode="json", exclude_unset=True, by_alias=True)
    return made | {"limits": limits}


@pytest.mark.parametrize(
    ("channel", "value", "words"),
    [
        ("t1_degC", 71.6, "looks like °F"),
        ("t1_degC", 295.0, "looks like K"),
        ("t1_degC", 3276.7, "fault code"),
        ("t1_degC", -3276.8, "fault code"),
        ("t1_degC", 215.0, "tenths of °C"),
        ("nut_position_m", 312.0, "looks like mm"),
        ("nut_position_m", 18.7, "looks like inches"),
        ("nut_position_m", -0.2, "below -0.05"),
        ("screw_speed_rpm", 9000.0, "degrees a second"),
        ("screw_speed_rpm", 90000.0, "revolutions an hour"),
    ],
)
def test_a_value_beyond_its_limits_is_rejected_with_its_unit(channel, value, words):
    aligner = Aligner(AlignPlan.of(live.demo()))
    aligner.ingest(Reading(1.0, {channel: value}))
    frame = aligner.tick(1.5)
    column = frame.channels.index(channel)
    assert frame.quality[0, column] == Quality.REJECTED
    assert math.isnan(frame.values[0, column])
    assert words in aligner.faults[channel]


def test_a_value_within_its_limits_is_believed_again_at_once():
    aligner = Aligner(AlignPlan.of(live.demo()))
    aligner.ingest(Reading(1.0, {"nut_position_m": 312.0}))
    aligner.tick(1.5)
    aligner.ingest(Reading(1.6, {"nut_position_m": 0.312}))
    frame = aligner.tick(2.0)
    assert frame.quality[0, frame.channels.index("nut_position_m")] == Quality.GOOD
    assert "nut_position_m" not in aligner.faults


def test_a_jump_is_rejected_until_time_would_allow_it():
    aligner = Aligner(AlignPlan.of(live.demo()))
    aligner.ingest(Reading(1.0, {"t1_degC": 22.0}))
    aligner.ingest(Reading(1.5, {"t1_degC": 52.0}))
    frame = aligner.tick(2.0)
    assert frame.quality[0, 0] == Quality.REJECTED
    assert "a change faster than 5 a second" in aligner.faults["t1_degC"]
    aligner.ingest(Reading(8.0, {"t1_degC": 52.0}))
    assert aligner.tick(8.5).quality[0, 0] == Quality.GOOD


def test_the_configuration_says_otherwise():
    config = parse(table(t1_degC={"high": 40.0}, nut_position_m={"low": -1.0, "high": 400.0}))
    limits = Limits.of(config)
    at = config.channels.index
    assert limits.doubt(at("t1_degC"), 41.0) is not None
    assert limits.doubt(at("t2_degC"), 41.0) is None
    assert limits.doubt(at("nut_position_m"), 312.0) is None
    with pytest.raises(ConfigError, match=r'no channel "t1_deg" \(did you mean t1_degC\?\)'):
        parse(table(t1_deg={"high": 40.0}))
    with pytest.raises(ConfigError, match="must be smaller"):
        parse(table(t1_degC={"low": 40.0, "high": 30.0}))


def test_a_heater_on_a_bench_may_be_hot():
    heated = live.demo().source[0].model_copy(update={"power_channel": "heater_W"})
    config = live.demo()
    hot = config.model_copy(update={"source": (heated, *config.source[1:])})
    assert Limits.of(config).doubt(0, 80.0) is not None
    assert Limits.of(hot).doubt(0, 80.0) is None


@pytest.mark.parametrize(
    ("value", "candidates"),
    [
        (6553.1, ['-0.5 °C read as an unsigned number (type = "int16")', "hundredths of °C"]),
        (65526.0, ['-10 °C read as an unsigned number (type = "int16")']),
        (429496724.6, ['-5 °C read as an unsigned number (type = "int32")']),
        (85.0, ["the 85 °C of a DS18B20 before its first conversion", "°F", "tenths of °C"]),
        (-127.0, ["a DS18B20 that is missing"]),
        (71.6, ["°F", "tenths of °C"]),
        (3276.7, ["a device's fault code (give it to its driver as fault_codes)", "hundredths of °C"]),
    ],
)
def test_a_hint_names_every_cause_that_fits_a_temperature(value, candidates):
    hint = unit_hint(ChannelKind.SCREW, value, -40.0, 150.0, 22.0)
    assert hint is not None
    assert hint.removeprefix("it looks like ").replace(" or ", ", ").split(", ") == candidates


def test_no_unit_is_guessed_where_none_fits():
    assert unit_hint(ChannelKind.SCREW, 9e5, -40.0, 150.0, math.nan) is None
    assert unit_hint(ChannelKind.OTHER, 1e9, -math.inf, math.inf, math.nan) is None
    assert Breach(0) is Breach.WITHIN_LIMITS


@pytest.mark.parametrize(
    ("ratio", "words"), [(9.5, "rad/s"), (59.0, "revolutions a second"), (2.0, "check lead_m")]
)
def test_a_ratio_of_distances_names_the_unit(ratio, words):
    assert words in motion_sentence("nut_position_m", "screw_speed_rpm", ratio)
    assert np.isfinite(ratio)


@pytest.mark.filterwarnings("error")
def test_a_log_whose_air_has_no_value_is_doubted_without_a_warning():
    config = parse(table() | {"ambient": {"channel": "air_degC"}})
    values = np.full((3, len(config.channels)), np.nan)
    assert list(doubts_of_log(config, values, config.channels, [])) == []


def warm(place, log_s, start_degC, *, by_more_K=0.0):
    """A log of a lathe's axis at rest, a row each half second; the thermocouple at `place` reads more."""
    config = load(CONFIG / "li-lathe-axis.toml")
    time_s = np.arange(0.0, log_s, 0.5)
    rng = np.random.default_rng(1)
    columns = {
        sensor.channel: start_degC
        + 0.1 * rng.standard_normal(len(time_s))
        + by_more_K * (sensor.name == place)
        for sensor in config.sensor
    }
    columns |= {"nut_position_m": np.full(len(time_s), 0.3), "screw_speed_rpm": np.zeros(len(time_s))}
    values = np.column_stack([columns[name] for name in config.channels])
    return config, Log(Path("warm.csv"), time_s, config.channels, values)


@pytest.mark.parametrize("place", ["t5", "t15"], ids=["first channel", "last channel"])
@pytest.mark.parametrize("log_s", [20.0, 600.0])
def test_a_screw_that_is_warm_when_a_log_begins_is_believed(place, log_s):
    config, log = warm(place, log_s, 66.0, by_more_K=6.0)
    frames = list(frames_of_log(log, AlignPlan.of(config)))
    rejected = sum(int(np.sum(block.quality == Quality.REJECTED)) for block in frames)
    assert rejected == 0
    assert not list(implausible(config, log.values, log.channels))
    converted, misread = in_configured_units(log, config)
    assert not misread
    assert converted is log


@pytest.mark.parametrize("log_s", [20.0, 600.0])
def test_a_single_channel_in_fahrenheit_is_rejected_in_a_log_of_any_length(log_s):
    config, log = warm("t15", log_s, 25.0, by_more_K=1.8 * 25.0 + 32.0 - 25.0)
    frames = list(frames_of_log(log, AlignPlan.of(config)))
    at = config.channels.index("t15_degC")
    assert all((block.quality[:, at] == Quality.REJECTED).all() for block in frames)
    [(name, share, sentence)] = implausible(config, log.values, log.channels)
    assert (name, share) == ("t15_degC", 1.0)
    assert "looks like °F" in sentence
    assert [each.unit for each in in_configured_units(log, config)[1]] == ["°F"]
