"""Small stand-ins for drive, estimator, publisher, driver and clock, so that the service is tested alone."""

import asyncio
import contextlib
import math
from dataclasses import dataclass, field

import numpy as np

from drivers.protocol import DriverStatus
from observer.bus.exchange import PublishStatus
from observer.estimate.pipeline import Pipeline
from observer.estimators.protocol import EstimatorState
from observer.frames import EstimateBlock, EstimateQuality, FrameBlock, Inputs, Layout, Quality, Reading
from observer.process.clock import ServiceClock
from observer.record.recorder import NoRecorder
from observer.service.loop import Service, serve
from tests.logs.recordings import plan as aligned
from tests.patience import PATIENCE_S, eventually

SENSORS = ("t1_degC", "t2_degC")


class FakeDrive:
    """Hands on everything a frame holds, and remembers a sum of it, so that no difference can hide."""

    def initial(self) -> float:
        return 0.0

    def run(self, state: float, frames: FrameBlock) -> tuple[float, Inputs]:
        k = len(frames)
        law = np.empty((k, 1))
        for i in range(k):
            for times, values, offset, *_ in frames.path.values():
                part = slice(offset[i], offset[i + 1])
                for time_s, value in zip(times[part], values[part], strict=True):
                    state = math.fmod(0.9 * state + value + 1e-9 * time_s, 1e6)
            law[i, 0] = state
        columns = [frames.channels.index(name) for name in SENSORS]
        inputs = Inputs(
            frames.time_s,
            frames.dt_s,
            frames.values[:, columns],
            frames.fresh[:, columns],
            frames.quality[:, columns],
            law,
            np.zeros((k, 1)),
            np.zeros((k, 0)),
            np.zeros((k, 0)),
            np.zeros((k, 0, 1)),
            np.zeros((k, 0, 1)),
            np.zeros(k, np.bool_),
            np.zeros(k),
            np.zeros(k),
        )
        return state, inputs


class FakeEstimator:
    """A running mean of whatever is usable; `fail` makes the next steps raise."""

    def __init__(self) -> None:
        self.layout = Layout(("nut",), np.array([0.0, 0.002225, 0.05]), ("t1", "t2"), True)
        self.fail = False

    def initial(self) -> EstimatorState:
        return EstimatorState(np.zeros(1), np.eye(1), False, np.zeros(2), np.zeros(2), np.zeros(2), 0.0)

    def run(self, state: EstimatorState, inputs: Inputs) -> tuple[EstimatorState, EstimateBlock]:
        if self.fail:
            raise ZeroDivisionError("made to fail")
        k, x, started = len(inputs), float(state.x_hat[0]), state.started
        field_degC, innovation = np.full((k, 3), np.nan), np.full((k, 2), np.nan)
        quality = np.full(k, int(EstimateQuality.INVALID), np.int8)
        for i in range(k):
            for j in range(2):
                if inputs.usable[i, j]:
                    innovation[i, j] = inputs.y_degC[i, j] - x
                    x += (0.1 + inputs.dt_s[i] % 1.0) * innovation[i, j]
                    started = True
            if started:
                field_degC[i] = x, x + inputs.law_W[i, 0], x * inputs.dt_s[i]
                bad = (inputs.quality[i] != Quality.GOOD).any()
                quality[i] = EstimateQuality.DEGRADED if bad else EstimateQuality.GOOD
        block = EstimateBlock(
            inputs.time_s, inputs.law_W, np.ones((k, 1)), field_degC, np.ones((k, 3)), 10 * field_degC,
            np.ones((k, 3)), innovation, inputs.quality, quality, np.ones((k, 2)), inputs.law_W,
        )  # fmt: skip
        return EstimatorState(
            np.array([x]), np.eye(1), started, np.zeros(2), np.zeros(2), np.zeros(2), 0.0
        ), block


@dataclass
class FakePublisher:
    """Keeps what it is given."""

    estimates: list = field(default_factory=list)
    alarms_: list = field(default_factory=list)
    readings_: list = field(default_factory=list)
    healths: list = field(default_factory=list)
    compensations: list = field(default_factory=list)
    asked: list = field(default_factory=list)
    started: bool = False
    closed: bool = False

    @property
    def status(self) -> PublishStatus:
        return PublishStatus(True, len(self.estimates), 0, 0, None)

    def start(self) -> None:
        self.started = True

    def commands(self) -> list:
        asked, self.asked = self.asked, []
        return asked

    def publish(self, block: EstimateBlock, sequence: int) -> None:
        self.estimates.append((sequence, block))

    def readings(self, frame, sequence: int) -> None:
        self.readings_.append((sequence, frame))

    def document(self, key: str, document) -> None:
        kept = {"health": self.healths, "alarms": self.alarms_, "compensation": self.compensations}
        kept[key].append(document)

    def close(self, timeout_s: float) -> bool:
        self.closed = True
        return True


@dataclass(frozen=True)
class FakeService(Service):
    """A service whose estimator, and what it reported to the service manager, can be looked at."""

    estimator: FakeEstimator = field(default_factory=FakeEstimator)
    notes: list = field(default_factory=list)


def fake_service(drivers, plan, clock, *, publisher=None, estimator=None, gap=None, **parts) -> FakeService:
    """A service of fakes."""
    estimator, notes = estimator or FakeEstimator(), []
    pipeline = Pipeline(FakeDrive(), estimator, None, gap)
    return FakeService(
        tuple(drivers), plan, pipeline, publisher or FakePublisher(), clock, notes.append,
        estimator=estimator, notes=notes, **parts,
    )  # fmt: skip


def loop_service(
    drivers=(), *, clock=None, period_s=0.1, expected_s=(0.1, 0.1, 0.02), recorder=None, **parts
) -> FakeService:
    """A service of fakes at so many steps a second, on a real clock unless another is given."""
    plan = aligned(expected_s=expected_s, period_s=period_s)
    return fake_service(drivers, plan, clock or ServiceClock(), recorder=recorder or NoRecorder(), **parts)


async def serve_until(service: Service, until, timeout_s: float = PATIENCE_S) -> None:
    """Serve until a condition holds."""
    task = asyncio.ensure_future(serve(service))
    await eventually(lambda: until() or task.done(), timeout_s)
    task.cancel()
    with contextlib.suppress(asyncio.CancelledError):
        await task


@dataclass
class FakeDriver:
    """Delivers a script of (seconds after the start, values, faults); an exception in it is raised.

    Readings are handed on `lag_s` after the moment they are stamped with.
    """

    script: list
    name: str = "fake"
    channels: tuple = ()
    period_s: float = 0.1
    status: DriverStatus = DriverStatus(connected=True)  # noqa: RUF009 (frozen)
    runs: int = 0
    lag_s: float = 0.0

    async def run(self, deliver, now) -> None:
        self.runs += 1
        start_s = now()
        while self.script:
            after_s, values, faults = self.script.pop(0)
            if isinstance(values, Exception):
                raise values
            await asyncio.sleep(max(0.0, start_s + after_s - now()))
            deliver(Reading(now() - self.lag_s, values, faults))
        await asyncio.Event().wait()


class FastClock:
    """A clock that jumps to the next tick at once; `late_s` is added after each sleep."""

    def __init__(self, start_s: float = 1000.2, late_s: tuple[float, ...] = ()) -> None:
        self.time_s = start_s
        self.late_s = list(late_s)
        self.offset = 0.0

    def now(self) -> float:
        self.time_s += 1e-6
        return self.time_s

    def offset_s(self) -> float:
        return self.offset

    async def go_on(self, seconds: float) -> None:
        """Wait until it has gone on by so much."""
        end_s = self.time_s + seconds
        await eventually(lambda: self.time_s > end_s)

    async def sleep_until(self, time_s: float) -> None:
        await asyncio.sleep(0)
        self.time_s = max(self.time_s, time_s) + (self.late_s.pop(0) if self.late_s else 0.0)
