"""The signal of a new zero: a rise, seen between ticks too, once; and a channel that is lost disarms."""

from __future__ import annotations

import math

import numpy as np

from observer.control.compensator import Compensator
from observer.control.steering import NoControl
from observer.files.logs import read_log
from observer.frames import Reading
from observer.quality.kinds import ConditionKind
from observer.record.recorder import Recorder
from observer.service.commands import Commands
from observer.service.observers import CompensationObserver, Step
from observer.service.zero_signal import ZeroSignal
from tests.control.test_compensate import GRID, at, estimate, machine
from tests.logs.recordings import CHANNELS


def _heard(signal: ZeroSignal, *values: float) -> int:
    for k, value in enumerate(values):
        signal.hear(Reading(10.0 + k, {"homed": value}))
    return len(signal.commands())


def test_only_a_rise_is_a_zero() -> None:
    assert _heard(ZeroSignal("homed", 1.5), 1.0, 1.0) == 0  # it may have been so for days
    assert _heard(ZeroSignal("homed", 1.5), 0.0, 0.0) == 0
    assert _heard(ZeroSignal("homed", 1.5), 1.0, 0.0, 1.0, 1.0, 0.0) == 1  # between two ticks
    signal = ZeroSignal("homed", 1.5)
    assert _heard(signal, 0.0, math.nan, 1.0) == 1
    assert _heard(signal, 1.0, 0.0) == 0
    signal.hear(Reading(20.0, {"homed": 1.0}, {"homed": "over_range"}))
    signal.hear(Reading(20.0, {"another": 1.0}))
    assert signal.commands() == []


def test_a_signal_is_lost_once_it_has_not_come_for_its_time() -> None:
    signal = ZeroSignal("homed", 1.5)
    assert signal.lost(10.0) == "homed, which reports a new zero, has no value (check its driver)"
    _heard(signal, 0.0)
    assert signal.lost(11.5) is None
    assert signal.lost(11.6) is not None


class _Loop:
    """Signal, commands and compensation, driven step by step."""

    def __init__(self, recorder: Recorder) -> None:
        self.config = machine(zero_channel="homed", hold_s=1.0, rate_limit_um_s=1e3, gradient_limit_um_m=1e3)
        self.compensator, self.documents = Compensator(self.config, GRID), []
        self.observer = CompensationObserver(
            self.compensator, self.documents.append, lambda: None, NoControl(), ZeroSignal("homed", 1.5)
        )
        self.commands = Commands(0.5, lambda: None, [self.observer], recorder.command)
        self.time_s = 10.0

    def step(self, *homed: float, quality: int = 0) -> dict:
        for value in homed:
            self.observer.hear(Reading(self.time_s, {"homed": value}))
        self.time_s += 0.5
        self.commands.before_step(self.observer.asks(), self.time_s)
        block = estimate(np.full(9, 30.0), self.time_s, quality)
        frame = at(self.config, self.time_s, 0.2)
        self.observer.follow(Step(frame, None, block, now_s=self.time_s))
        self.commands.after_step(self.time_s)
        return self.documents[-1]


def test_a_rise_zeroes_and_is_recorded_as_a_command_and_silence_disarms(tmp_path) -> None:
    recorder = Recorder(tmp_path, "m-x", CHANNELS, 1e9, 0.5)
    loop = _Loop(recorder)
    loop.step(0.0)
    loop.compensator.arm()
    assert loop.step(0.0)["armed"]
    homed = loop.step(0.0, 1.0, 0.0)
    assert not homed["armed"]
    assert homed["reason"] == "switched off at 11.0 s: homed@signal has zeroed the machine; arm again"
    assert homed["zero"]["error_um"] == 30.0
    loop.compensator.arm()
    assert loop.step(0.0)["armed"]
    for _ in range(2):
        silent = loop.step()
    assert silent["phase"] == "following"
    silent = loop.step()
    assert silent["hold_reason"] == "homed, which reports a new zero, has no value (check its driver)"
    silent = loop.step()
    assert silent["armed"]
    silent = loop.step()
    assert silent["reason"].endswith(
        ": homed, which reports a new zero, has no value (check its driver); arm again"
    )
    (released,) = loop.observer.conditions()
    assert (released.kind, released.detail) == (ConditionKind.RELEASED, silent["reason"])
    loop.step(1.0, quality=2)
    _, refused = loop.observer.conditions()
    assert refused.kind is ConditionKind.NOT_ZEROED
    assert refused.detail.startswith("zero refused: the estimate is degraded")
    assert recorder.close(5.0)
    (path,) = tmp_path.glob("*.csv")
    flags = [flags for flags in read_log(path, CHANNELS).flags if flags]
    assert flags[0] == "!zero=done by homed%40signal"
    assert flags[1].startswith("!zero=refused to homed%40signal: zero refused: ")


def test_a_compensation_that_was_never_armed_has_no_condition() -> None:
    observer = CompensationObserver(
        Compensator(machine(), GRID), lambda _document: None, lambda: None, NoControl()
    )
    assert observer.conditions() == ()
