"""Commands are obeyed between two steps, answered with what was done, and put on record for the replay."""

import time
from dataclasses import replace

import numpy as np
import structlog

from observer.align.aligner import commands_of, faults_of
from observer.bus.exchange import Command, Outcome, PublishStatus
from observer.control.compensation import NOT_ARMED, CompensationState
from observer.control.compensator import Compensator
from observer.control.steering import NoControl
from observer.estimate.pipeline import Pipeline
from observer.estimate.replay import estimates_of
from observer.files.logs import Log, read_log
from observer.frames import EstimateQuality, Reading
from observer.record.recorder import NoRecorder, Recorder
from observer.service.commands import Commands
from observer.service.observers import CompensationObserver, StepObserver
from tests.control.test_compensate import GRID, at, estimate, machine
from tests.logs.recordings import CHANNELS, plan
from tests.service.fakes import (
    FakeDrive,
    FakeDriver,
    FakeEstimator,
    FakePublisher,
    FastClock,
    loop_service,
    serve_until,
)


def _command(
    kind: str, answers: list, *, asked_s: float | None = None, refused: str | None = None
) -> Command:
    return Command(
        kind, "anna@desk", time.monotonic() if asked_s is None else asked_s, answers.append, refused
    )


async def test_the_replay_of_a_recording_is_the_live_run_with_its_resets_to_the_last_bit(tmp_path):
    rng = np.random.default_rng(7)
    slow = []
    for k in range(600):
        values = {"t1_degC": rng.normal(20, 1), "t2_degC": rng.normal(30, 1)}
        slow.append((0.1 * k, values, {"t2_degC": "open_circuit"} if k % 7 == 3 else {}))
    fast = [(0.02 * k, {"nut_position_m": rng.uniform(0.2, 0.8)}, {}) for k in range(3000)]
    recorder, answers = Recorder(tmp_path, "m-x", CHANNELS, 1e9, 0.5), []
    drivers = [FakeDriver(slow, "slow", lag_s=0.05), FakeDriver(fast, "fast")]
    service = loop_service(
        drivers, recorder=recorder, expected_s=(1.0, 1.0, 0.2)
    )  # a busy machine's readings come late
    asked = [10, 11, 20]

    def until():
        if asked and len(service.publisher.estimates) >= asked[0]:
            asked.pop(0)
            service.publisher.asked.append(_command("reset", answers))
        return len(answers) == 3 and len(service.publisher.estimates) >= 25

    await serve_until(service, until)
    assert [(outcome.done, outcome.text) for outcome in answers] == [(True, "the estimator restarts")] * 3
    (path,) = tmp_path.glob("m-x-*.csv")
    assert path.read_text().count(",!reset=done by anna%40desk\n") == 3
    log = read_log(path, CHANNELS)
    np.testing.assert_array_equal(np.diff(log.time_s) > 0, True)
    live = [block for _, block in service.publisher.estimates]

    def replay(log):
        pipeline = Pipeline(FakeDrive(), FakeEstimator())
        return [block for _, block in estimates_of(log, service.plan, pipeline, lambda done, total: None)]

    def bits(blocks, name):
        return np.concatenate([getattr(block, name) for block in blocks]).tobytes()

    replayed = replay(log)
    for name in ("time_s", "heat_W", "field_degC", "innovation_K", "sensor_quality", "quality"):
        assert bits(replayed, name) == bits(live, name), name
    assert EstimateQuality.DEGRADED in {quality for block in live for quality in block.quality}
    without = replace(log, flags=tuple((flags or "").partition("!")[0] for flags in log.flags))
    assert bits(replay(without), "field_degC") != bits(live, "field_degC")  # the resets were needed


def test_a_command_is_not_a_fault_of_any_channel():
    assert faults_of("!reset=done by anna") == {}
    assert faults_of("t1_degC=open_circuit;!arm=done by a") == {"t1_degC": "open_circuit"}
    assert faults_of("%21reset=open_circuit") == {"!reset": "open_circuit"}  # a channel of that name


def test_the_commands_of_a_recording_are_listed_with_their_time_and_outcome():
    flags = (
        None,
        "!zero=done by homed%40x",
        "a=silent",
        "!arm=refused to a%3Bb: no;!reset=done by a",
    )
    log = Log("run.csv", np.arange(4.0), CHANNELS, np.full((4, 3), np.nan), np.zeros(4, bool), flags)
    assert commands_of(log) == [
        {"time_s": 1.0, "command": "zero", "outcome": "done by homed@x"},
        {"time_s": 3.0, "command": "arm", "outcome": "refused to a;b: no"},
        {"time_s": 3.0, "command": "reset", "outcome": "done by a"},
    ]
    assert commands_of(replace(log, flags=None)) == []


class _Loop:
    """Commands beside a real compensator, driven step by step."""

    def __init__(self, config=None, recorder=None) -> None:
        self.config = config or machine(rate_limit_um_s=1e3, gradient_limit_um_m=1e3)
        self.compensator = Compensator(self.config, GRID)
        self.resets = 0
        self.observer = CompensationObserver(
            self.compensator, lambda _document: None, lambda: None, NoControl()
        )
        record = NoRecorder().command if recorder is None else recorder.command
        self.commands = Commands(0.5, self._reset, [self.observer], record)
        self.time_s = 10.0
        self.document: dict = {}

    def _reset(self) -> None:
        self.resets += 1

    def step(self, *commands: Command, error_um: float = 5.0, quality: int = 0) -> None:
        self.time_s += 0.5
        self.commands.before_step(commands, self.time_s)
        block = estimate(np.full(9, error_um), self.time_s, quality)
        self.document = self.compensator.step(block, at(self.config, self.time_s, 0.2), 0)
        self.commands.after_step(self.time_s)


def test_the_answer_says_what_was_really_done():
    loop, answers = _Loop(), []
    remedy = "(find the cause, or raise the limit)"
    beyond = f"the error of 300 µm is beyond compensation.limit_um = 200 µm {remedy}, so it cannot be armed"
    loop.step(_command("disarm", answers))
    loop.step(_command("arm", answers), quality=2)
    loop.step(_command("arm", answers))
    assert loop.document["armed"] is True
    loop.step(_command("disarm", answers))
    assert loop.document["armed"] is False
    loop.step(_command("arm", answers), error_um=300.0)
    loop.step(_command("arm", answers), _command("disarm", answers))
    loop.step(_command("arm", answers))
    loop.step(_command("reset", answers))
    assert loop.document["armed"] is False
    assert loop.resets == 1
    loop.step()
    assert loop.document["reason"].endswith(": anna@desk has reset the estimator; arm again")
    assert [(outcome.done, outcome.text) for outcome in answers] == [
        (True, "it was off already: not armed yet"),
        (False, "not armed: the estimate is degraded, so it cannot be armed"),
        (True, "armed"),
        (True, "disarmed"),
        (False, f"not armed: {beyond}"),
        (False, "not armed: disarmed by anna@desk; arm again"),
        (True, f"it was off already: {beyond}"),
        (True, "armed"),
        (True, "the estimator restarts"),
    ]


def test_a_command_that_waited_is_not_obeyed():
    loop, answers = _Loop(), []
    loop.step(_command("arm", answers, asked_s=time.monotonic() - 6.0))
    loop.step()
    assert loop.document["armed"] is False
    assert answers == [Outcome(False, "not done: it waited too long; ask again", answers[0].time_s)]


def test_without_a_compensation_there_is_nothing_to_arm():
    answers = []
    commands = Commands(0.5, lambda: None, [StepObserver()], NoRecorder().command)
    commands.before_step([_command(kind, answers) for kind in ("arm", "disarm", "acknowledge")], 1.0)
    commands.after_step(1.0)
    assert [outcome.done for outcome in answers] == [False, False, False]
    assert "set enabled = true in [compensation]" in answers[0].text
    assert "set enabled = true in [alarms]" in answers[2].text


def test_everything_asked_is_logged_and_recorded(tmp_path):
    recorder, answers = Recorder(tmp_path, "m-x", CHANNELS, 1e9, 0.5), []
    loop = _Loop(recorder=recorder)
    with structlog.testing.capture_logs() as logs:
        loop.step(_command("arm", answers), _command("reset", answers, refused='a, b; c=\n"d"'))
    assert recorder.close(5.0)
    assert [(e["command"], e["done"], e["by"]) for e in logs] == [
        ("reset", False, "anna@desk"), ("arm", True, "anna@desk")
    ]  # fmt: skip
    (path,) = tmp_path.glob("*.csv")
    rows = path.read_text().splitlines()[1:]
    assert [row.partition(";#crc=")[0] for row in rows] == [
        "10.499999999999998,,,,,,!reset=refused to anna%40desk: a%2C b%3B c%3D%0A%22d%22",
        "10.5,,,,,,!arm=done by anna%40desk",
    ]
    log = read_log(path, CHANNELS)
    assert not log.step.any()
    assert len(answers) == 1  # who was refused knows already


async def test_a_foreign_message_releases_the_compensation_and_shows_in_health():
    rival = "another service runs as ballscrew/m/x (instance 0b0b0b0b); end one of the two"

    class Shared(FakePublisher):
        rival: str | None = None

        @property
        def status(self) -> PublishStatus:
            return PublishStatus(True, reason=self.rival, duplicate=self.rival)

    class Follower:
        def __init__(self) -> None:
            self.released: list[str] = []

        reason = NOT_ARMED
        state = CompensationState(NOT_ARMED, 0.0, np.zeros(2), np.zeros(2))

        def see_clock(self, offset_s):
            pass

        def release(self, cause):
            self.released.append(cause)

        def step(self, *_):
            return b"{}"

    publisher, follower = Shared(), Follower()
    observer = CompensationObserver(
        follower, lambda _document: None, lambda: publisher.status.duplicate, NoControl()
    )
    service = loop_service(publisher=publisher, clock=FastClock(), observers=(observer,), instance="0a0a0a0a")

    def until():
        if len(publisher.estimates) >= 3:
            assert publisher.rival or not follower.released
            publisher.rival = rival
        return any(rival in reason for h in publisher.healths for reason in h["reasons"])

    await serve_until(service, until)
    assert follower.released[0] == rival
    assert publisher.healths[-1]["instance"] == "0a0a0a0a"


async def test_a_dead_publisher_ends_the_pings_of_the_watchdog():
    class Mortal(FakePublisher):
        alive = True

        @property
        def status(self) -> PublishStatus:
            return PublishStatus(True, alive=self.alive, reason=None if self.alive else "dead")

    publisher = Mortal()
    service = loop_service(publisher=publisher, clock=FastClock())
    notes = service.notes
    pings = []

    def until():
        if len(publisher.estimates) >= 5 and publisher.alive:
            assert "WATCHDOG=1" in notes
            publisher.alive = False
            pings.append((len(notes), len(publisher.estimates)))
        return pings and len(publisher.estimates) >= pings[0][1] + 50

    await serve_until(service, until)
    assert len(notes) == pings[0][0]
    assert any("publishing: dead" in h["reasons"] for h in publisher.healths)


def test_a_reading_without_values_changes_no_frame():
    from observer.align.aligner import Aligner

    frames = []
    for extra in (False, True):
        aligner = Aligner(plan())
        aligner.ingest(Reading(1.0, {"t1_degC": 20.0, "t2_degC": 21.0}))
        if extra:
            aligner.ingest(Reading(1.2, {}))
        frames.append(aligner.tick(1.5))
    for name in ("time_s", "values", "fresh", "quality", "age_s"):
        assert getattr(frames[0], name).tobytes() == getattr(frames[1], name).tobytes()
