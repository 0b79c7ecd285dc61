"""Channels that send only on change: good until their heartbeat has passed, live and in a replay."""

from __future__ import annotations

import math
import tomllib
from dataclasses import replace
from pathlib import Path

import can
import numpy as np
import pytest

from observer.align.aligner import Aligner, AlignPlan, frames_of_log
from observer.errors import ConfigError
from observer.estimate.pipeline import MachineModel
from observer.estimate.replay import estimates_of
from observer.files.logs import Log, read_log
from observer.frames import EstimateBlock, FrameBlock, Quality, Reading
from observer.installation import parse
from observer.record.recorder import header, row_of_reading
from observer.report.check import findings
from observer.service.wire_doubts import wires_of
from tests.drivers.harness import running
from tests.drivers.test_can import frame, virtual_bus
from tests.logs.recordings import joined, plan, same_bits, tick_row, write

DEMO = Path(__file__).parents[2] / "config" / "demo.toml"
SENSORS = tuple(f"t{i}_degC" for i in range(1, 6))
HEARTBEAT_S, PERIOD_S = 2.0, 0.1
AXIS = ("nut_position_m", "screw_speed_rpm")


def table(*, heartbeat_s=HEARTBEAT_S, channels=(*SENSORS, *AXIS), **axis):
    """The demo's machine with thermocouples and axis on two virtual buses."""
    machine = tomllib.loads(DEMO.read_text(encoding="utf-8"))
    machine["estimator"]["period_s"] = PERIOD_S
    wire = {"kind": "can", "interface": "virtual", "period_s": 0.05, "timeout_s": 0.15}
    inputs = {name: number for number, name in enumerate(SENSORS)}
    thermocouples = wire | {"channel": "tc", "device": "peak_mu_thermocouple1", "channels": inputs}
    machine["drivers"] = {
        "thermocouples": thermocouples,
        "axis": machine["drivers"]["axis"] | wire | {"channel": "axis"} | axis,
    }
    machine["limits"] = {name: {"on_change": True, "heartbeat_s": heartbeat_s} for name in channels}
    return machine


def temperatures(celsius):
    """Both frames of the module, in sixteenths of a degree."""
    word = int(16 * celsius).to_bytes(2, "little")
    return [can.Message(arbitration_id=i, is_extended_id=False, data=4 * word) for i in (0x100, 0x101)]


async def readings_of(config):
    """Send every value once, stay silent beyond the heartbeat, and send the temperatures again."""
    thermocouples, axis = config.open_drivers()
    states = []
    with virtual_bus("tc") as tc_bus, virtual_bus("axis") as axis_bus:
        async with running(thermocouples) as module, running(axis) as drive:
            await module.until(lambda _: thermocouples.status.connected)
            await drive.until(lambda _: axis.status.connected)
            axis_bus.send(frame(0.25, 0.0))
            for message in temperatures(21.0):
                tc_bus.send(message)
            begin_s = (await module.until(lambda r: math.isfinite(r.values.get("t5_degC", math.nan)))).time_s
            while (reading := (await drive.more(1))[-1]).time_s < begin_s + 1.5 * HEARTBEAT_S:
                if reading.time_s < begin_s + 0.8 * HEARTBEAT_S:
                    states.append(axis.status.state)
            seen = len(module.readings)
            while not (again := [r for r in module.readings[seen:] if not r.faults]):
                for message in temperatures(22.0):
                    tc_bus.send(message)
                await module.more(1)
    end_s = again[0].time_s
    readings = sorted((r for r in [*module.readings, *drive.readings]), key=lambda r: r.time_s)
    return [r for r in readings if r.time_s <= end_s + PERIOD_S], begin_s, states


def played(readings, aligner, begin_s) -> tuple[FrameBlock, bytes]:
    """The frames of readings as the service makes them, a tick each period, and the recording."""
    channels = aligner._plan.channels
    recording, blocks, tick_s = header(channels), [], begin_s + 0.5 * PERIOD_S
    for reading in [*readings, Reading(readings[-1].time_s + PERIOD_S, {})]:
        while tick_s < reading.time_s:
            blocks.append(aligner.tick(tick_s))
            recording += tick_row(blocks[-1].time_s[0].item(), channels)
            tick_s += PERIOD_S
        for news in aligner.news_of(reading):
            recording += row_of_reading(aligner.ingest(news), channels)
    return blocks, recording


async def test_silence_on_a_can_bus_is_good_until_the_heartbeat_has_passed(tmp_path, monkeypatch):
    monkeypatch.setattr("drivers.places.SILENCE_S", 0.3)  # a quiet bus is opened again sooner
    config = parse(table())
    readings, begin_s, states = await readings_of(config)
    assert set(states) == {"connected"}
    assert any("silent" in r.faults.values() for r in readings)
    machine = MachineModel.of(config)
    blocks, recording = played(readings, Aligner(machine.plan), begin_s)
    live = joined(blocks)
    columns = [machine.plan.channels.index(name) for name in (*SENSORS, *AXIS)]
    quality, age_s = live["quality"][:, columns], live["age_s"][:, columns]
    silent = age_s > HEARTBEAT_S
    assert (quality[~silent] == Quality.GOOD).all()
    assert (quality[silent] == Quality.STALE).all()
    assert silent.any()
    assert age_s[~silent].max() > 0.9 * HEARTBEAT_S
    assert live["fresh"][:, columns[:5]].sum(axis=0).tolist() == [2] * 5
    log = read_log(write(tmp_path, recording))
    assert same_bits(live, joined(list(frames_of_log(log, machine.plan))))
    steps = estimates_of(log, machine.plan, machine.pipeline(), lambda done, total: None)
    estimates = EstimateBlock.joined([estimate for _, estimate in steps])
    np.testing.assert_array_equal(estimates.used, ~silent[:, :5])
    np.testing.assert_array_equal(np.isfinite(estimates.innovation_K), live["fresh"][:, columns[:5]])


def doubting(heartbeat_s=60.0, **more):
    """A plan of which t1 and the position send only on change."""
    never = math.nan
    made = plan(expected_s=(never, 0.5, never), noise_K=(never, 0.05, never), **more)
    return replace(made, heartbeat_s=np.array([heartbeat_s, never, heartbeat_s]))


def test_a_lost_wire_is_a_fault_at_once_and_silence_is_none():
    aligner = Aligner(doubting())
    aligner.ingest(Reading(0.0, {"t1_degC": 20.0}))
    silence = Reading(
        1.0, dict.fromkeys(("t1_degC", "t2_degC"), math.nan), dict.fromkeys(("t1_degC", "t2_degC"), "silent")
    )
    (news,) = aligner.news_of(silence)
    assert news.faults == {"t2_degC": "silent"}
    (lost,) = aligner.news_of(Reading(2.0, {"t1_degC": math.nan}, {"t1_degC": "disconnected"}))
    aligner.ingest(lost)
    assert aligner.tick(3.0).quality[0, 0] == Quality.REJECTED


def test_positions_after_a_pause_keep_their_times():
    aligner = Aligner(doubting())
    times_s = [0.0, 50.0, 100.1, 100.2, 100.3, 100.35, 100.4]
    for time_s in times_s[:2]:
        aligner.ingest(Reading(time_s, {"nut_position_m": 0.1 + 1e-3 * time_s}))
    aligner.tick(100.0)
    for time_s in times_s[2:]:
        aligner.ingest(Reading(time_s, {"nut_position_m": 1e-3 * time_s}))
    assert aligner.tick(100.5).path["nut_position_m"].time_s.tolist() == times_s[2:]


def test_equal_heartbeats_are_no_stuck_sensor():
    made = AlignPlan.of(parse(table()))
    aligner, noise_K = Aligner(made), np.random.default_rng(1).normal(0.0, 0.1, 100)
    for k, value in enumerate([*(21.0 + noise_K), *[21.0] * 500]):
        aligner.ingest(Reading(float(k), {"t1_degC": value}))
    assert aligner.tick(600.0).quality[0, 0] == Quality.GOOD


def test_an_empty_cell_of_a_plain_log_is_no_missing_value():
    made = AlignPlan.of(parse(table(heartbeat_s=60.0, channels=("t1_degC",))))
    time_s = np.arange(0.0, 200.0, 1.0)
    t1_degC = np.full(200, np.nan)
    came = np.arange(0, 130, 10)
    t1_degC[came] = 21.0 + 0.1 * np.arange(len(came))
    log = Log(Path("log.csv"), time_s, ("t1_degC",), t1_degC[:, None])
    frames = joined(list(frames_of_log(log, made)))
    late = time_s > time_s[came[-1]] + 60.0
    assert (frames["quality"][:, 0] == np.where(late, Quality.STALE, Quality.GOOD)).all()
    assert np.flatnonzero(frames["fresh"][:, 0]).tolist() == came.tolist()


def _with(limit=None, **axis):
    machine = table(**axis)
    machine["limits"]["t1_degC"] = limit or machine["limits"]["t1_degC"]
    return machine


OCCASIONAL = {"kind": "displacement", "channel": "d_um", "position_m": 0.5, "occasional": True}


@pytest.mark.parametrize(
    ("machine", "words"),
    [
        (_with({"on_change": True}), "on_change needs heartbeat_s; add it"),
        (_with({"heartbeat_s": 60}), "on_change = true only"),
        (_with({"on_change": 1, "heartbeat_s": 60}), "on_change"),
        *((_with({"on_change": True, "heartbeat_s": s}), "heartbeat_s") for s in (0, -1, 1e9, "x", math.nan)),
        (_with() | {"estimator": {"period_s": 5.0}}, "shorter than the 5 s"),
        (_with(reopen_s=1.0), "reopen_s = 1 is shorter than the heartbeat_s = 2"),
        (
            _with() | {"sensor": [*table()["sensor"], OCCASIONAL | {"name": "d"}],
                       "limits": {"d_um": {"on_change": True, "heartbeat_s": 60.0}}},
            "remove occasional, or on_change",
        ),
    ],
)  # fmt: skip
def test_a_heartbeat_that_makes_no_sense_is_refused(machine, words):
    with pytest.raises(ConfigError, match=words):
        parse(machine)


def test_a_bus_with_a_cyclic_sender_is_opened_again_as_before():
    assert parse(table(channels=("nut_position_m",), reopen_s=1.0)).open_drivers()[1]._bus.reopen_s == 1.0


def test_the_check_explains_a_channel_that_sends_only_on_change(monkeypatch):
    monkeypatch.setattr("observer.service.one_look.LOOK_S", 0.5)
    config = parse(table(channels=("t1_degC",)))
    assert findings(config)["heartbeat_s"] == {"t1_degC": HEARTBEAT_S}
    found = wires_of(config)["drivers"]["thermocouples"]["channels"]
    assert "sends only on change, at the latest every 2 s" in found["t1_degC"]["remedy"]
    assert "bit rate" in found["t2_degC"]["remedy"]
