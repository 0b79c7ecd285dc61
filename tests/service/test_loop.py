"""The loop: ticks on the grid, nothing beside it ends it, live and replay agree to the last bit."""

import asyncio
import math
from dataclasses import replace
from functools import partial
from typing import ClassVar

import numpy as np
import pytest

from drivers.protocol import DriverStatus
from observer.control.compensation import NOT_ARMED, CompensationState
from observer.control.steering import NoControl
from observer.estimators.protocol import SENSOR_GUARD
from observer.files.logs import read_log
from observer.frames import EstimateQuality, Reading
from observer.kernels.codes import JUMPED
from observer.quality.gap import Departure
from observer.record.recorder import Recorder
from observer.service.loop import Service, serve
from observer.service.observers import CompensationObserver, StepObserver
from observer.service.restarts import Restarts
from tests.logs.recordings import CHANNELS
from tests.patience import eventually
from tests.service.fakes import (
    FakeDriver,
    FakeEstimator,
    FakePublisher,
    FastClock,
    loop_service,
    serve_until,
)


def _ticks(service: Service) -> list[float]:
    return [float(block.time_s[0]) for _, block in service.publisher.estimates]


async def test_late_ticks_stay_on_the_grid_without_drift():
    service = loop_service(clock=FastClock(late_s=(0.03,) * 50), period_s=0.5)
    await serve_until(service, lambda: len(service.publisher.estimates) >= 20)
    ticks = _ticks(service)
    assert ticks == [1000.5 + 0.5 * k for k in range(len(ticks))]
    assert [sequence for sequence, _ in service.publisher.estimates] == list(range(len(ticks)))


async def test_a_late_tick_skips_to_the_next_grid_point_and_is_counted():
    service = loop_service(clock=FastClock(late_s=(0.0, 1.7)), period_s=0.5)
    # the health that counts it is due within five seconds
    await serve_until(service, lambda: any(h["overruns"] for h in service.publisher.healths))
    assert _ticks(service)[:4] == [1000.5, 1001.0, 1003.0, 1003.5]
    assert service.publisher.healths[-1]["overruns"] == 3


async def test_a_service_starts_and_ends_every_part():
    service = loop_service([driver := FakeDriver([])])
    await serve_until(service, lambda: service.publisher.estimates)
    assert service.publisher.started
    assert service.publisher.closed
    assert driver.runs == 1
    assert service.notes[:2] == ["READY=1\nWATCHDOG=1", "WATCHDOG=1"][: len(service.notes)]


async def test_a_failing_step_is_reported_and_the_watchdog_not_fed():
    service = loop_service(clock=FastClock())
    task = asyncio.ensure_future(serve(service))
    await eventually(lambda: service.publisher.estimates)
    service.estimator.fail = True
    await service.clock.go_on(10)
    pings, before = len(service.notes), len(service.publisher.estimates)
    await service.clock.go_on(10)
    assert (len(service.notes), len(service.publisher.estimates)) == (pings, before)
    health = service.publisher.healths[-1]
    assert health["state"] == "invalid"
    assert "made to fail" in health["reasons"][0]
    service.estimator.fail = False
    await eventually(lambda: len(service.publisher.estimates) > before)
    task.cancel()
    await asyncio.wait([task])


class _Follower:
    """In the place of a compensator: returns what it was given."""

    reason = NOT_ARMED
    state = CompensationState(NOT_ARMED, 0.0, np.zeros(2), np.zeros(2))

    def see_clock(self, offset_s):
        assert offset_s == 0.0

    def step(self, block, frame, sequence, cause):
        return f"step {sequence} {block.time_s[0] == frame.time_s[0]}".encode()

    def fail(self, time_s, sequence, reason):
        return f"fail {sequence} {reason}".encode()


async def test_a_compensator_follows_every_step_and_hears_of_those_that_fail():
    publisher = FakePublisher()
    document = partial(publisher.document, "compensation")
    follower = CompensationObserver(_Follower(), document, lambda: None, NoControl())
    service = loop_service(clock=FastClock(), publisher=publisher, observers=(follower,))

    def failing() -> bool:
        service.estimator.fail |= len(publisher.compensations) >= 3
        return publisher.compensations[-1:] != [] and publisher.compensations[-1].startswith(b"fail")

    await serve_until(service, failing)
    assert publisher.compensations[:2] == [b"step 0 True", b"step 1 True"]
    assert b"made to fail" in publisher.compensations[-1]


async def test_a_driver_that_fails_is_started_again_and_the_others_go_on():
    bad = FakeDriver([(0, RuntimeError("driver fell over"), {}), (0, {"t1_degC": 20.0}, {})], "bad")
    good = FakeDriver([(0.05 * k, {"t2_degC": 20.0 + k}, {}) for k in range(100)], "good")
    service = loop_service([bad, good])
    await serve_until(service, lambda: bad.runs == 2 and not bad.script)
    assert len(good.script) < 95
    channels = service.publisher.healths[-1]["channels"]
    assert channels["t2_degC"]["quality"] == "good"


async def test_readings_from_the_future_or_the_past_are_not_believed():
    service = loop_service(clock=FastClock(), period_s=0.5)

    class Odd(FakeDriver):
        async def run(self, deliver, now):
            deliver(Reading(now() + 3600, {"t1_degC": 20.0}))
            deliver(Reading(now(), {"t2_degC": 21.0}))
            deliver(Reading(now() - 3600, {"t2_degC": 22.0}))
            deliver(Reading(math.nan, {"nut_position_m": 0.1}))
            await asyncio.Event().wait()

    def is_rejected(health):
        channel = health["channels"]["t2_degC"]
        return (channel["quality"], channel["fault"]) == ("rejected", "time_backwards")

    service = replace(service, drivers=(Odd([]),))
    await serve_until(service, lambda: any(map(is_rejected, service.publisher.healths)))
    health = service.publisher.healths[-1]
    assert health["channels"]["t1_degC"]["fault"] is None
    assert _ticks(service)[0] < 1010


class _LeavesOut(FakeEstimator):
    """Has the second sensor excluded."""

    def run(self, state, inputs):
        state, block = super().run(state, inputs)
        guard = np.zeros(2, SENSOR_GUARD)
        guard[1].cause, guard[1].excess_K, guard[1].excess_sigma_K = JUMPED, 3.0, 0.2
        return replace(state, guard=guard), block


async def test_an_excluded_sensor_is_shown_at_its_channel():
    driver = FakeDriver([(0.0, dict.fromkeys(CHANNELS, 20.0), {})] * 3)
    names = {"t1_degC": "t1", "t2_degC": "t2"}
    service = loop_service([driver], estimator=_LeavesOut(), sensors=names)

    def excesses():
        return {
            n: c["excess"]
            for h in service.publisher.healths
            for n, c in h["channels"].items()
            if "excess" in c
        }

    await serve_until(service, excesses)
    assert excesses() == {"t2_degC": {"value": 3.0, "sigma": 0.2, "unit": "K"}}


async def test_health_is_published_at_least_every_five_seconds():
    service = loop_service(clock=FastClock(), period_s=0.5)
    await serve_until(service, lambda: len(service.publisher.estimates) >= 60)
    times = [h["time_s"] for h in service.publisher.healths]
    assert len(times) >= 4
    assert np.diff(times).max() < 5.6  # five seconds and the tick after them
    changes = [h["state"] for h in service.publisher.healths]
    assert set(changes) == {"starting"}


async def test_a_stepped_clock_is_reported():
    clock = FastClock()
    service = loop_service(clock=clock, period_s=0.5)
    task = asyncio.ensure_future(serve(service))
    await eventually(lambda: service.publisher.healths)
    clock.offset = 3600.0
    await eventually(
        lambda: any("clock stepped by +3600.0 s" in r for r in service.publisher.healths[-1]["reasons"])
    )
    assert service.publisher.healths[-1]["clock_offset_s"] == 3600.0
    task.cancel()
    await asyncio.wait([task])


async def test_an_unconnected_driver_is_reported():
    driver = FakeDriver([], status=DriverStatus(last_error="connection refused"))
    service = loop_service([driver], clock=FastClock())
    await serve_until(service, lambda: service.publisher.healths)
    reasons = service.publisher.healths[-1]["reasons"]
    assert "driver fake is not connected: connection refused" in reasons


async def test_a_reading_between_the_grid_point_and_its_late_tick_is_recorded_in_the_order_of_use(tmp_path):
    class Between(FakeDriver):
        hand_on = staticmethod(lambda: None)  # until it runs: the first tick may be before

        async def run(self, deliver, now):
            self.hand_on = lambda: deliver(Reading(now(), {"t1_degC": 20.0, "t2_degC": 21.0}))
            await asyncio.Event().wait()

    class LateClock(FastClock):
        async def sleep_until(self, time_s):
            await super().sleep_until(time_s)
            driver.hand_on()  # its time is after the grid point for which the tick is

    driver = Between([])
    recorder = Recorder(tmp_path, "m-x", CHANNELS, 1e9, 0.5)
    service = loop_service([driver], clock=LateClock(late_s=(0.01,) * 1000), recorder=recorder, period_s=0.5)
    await serve_until(service, lambda: len(service.publisher.estimates) >= 20)
    (path,) = tmp_path.glob("*.csv")
    log = read_log(path, CHANNELS)
    ticks = _ticks(service)
    np.testing.assert_array_equal(log.time_s[log.step], ticks)
    assert all(block.innovation_K.all() for _, block in service.publisher.estimates)  # each used at once


async def test_a_dead_recorder_is_reported_and_the_watchdog_not_fed(tmp_path, monkeypatch):
    def defect(*_):
        raise ZeroDivisionError("a defect")

    recorder = Recorder(tmp_path, "m-x", CHANNELS, 1e9, 0.5)
    service = loop_service(recorder=recorder)
    task = asyncio.ensure_future(serve(service))
    await eventually(lambda: service.notes)
    monkeypatch.setattr(recorder, "_drain", defect)
    await eventually(lambda: not recorder.alive)
    ticks, notes = len(service.publisher.estimates), len(service.notes)
    await eventually(lambda: len(service.publisher.estimates) >= ticks + 10)
    assert len(service.notes) <= notes + 1  # one may have been on its way
    await eventually(lambda: any("a defect" in r for r in service.publisher.healths[-1]["reasons"]))
    task.cancel()
    await asyncio.wait([task])


async def test_before_a_restart_the_parts_end_and_clients_learn_the_reason():
    keeper = _Keeping()
    driver = FakeDriver([(0, {"t1_degC": 20.0, "t2_degC": 20.0}, {})])
    service = loop_service([driver], clock=FastClock(), period_s=0.5)
    service = replace(service, restarts=Restarts(dict), observers=(keeper,))
    task = asyncio.ensure_future(serve(service))
    await eventually(lambda: [b for _, b in service.publisher.estimates if np.isfinite(b.field_degC).all()])
    assert service.publisher.healths[-1]["restart"] is None
    service.clock.offset = 60.0
    reason = await task
    assert "clock was set" in reason
    assert service.publisher.closed
    assert service.publisher.healths[-1]["restart"]["reason"] == reason
    assert service.notes[-1].startswith("RELOADING=1\nMONOTONIC_USEC=")
    # the snapshot has the new time of the clock
    last = service.publisher.estimates[-1][1]
    assert keeper.snapshot.tick_s == last.time_s[0] + 60.0
    # and a service goes on from there: the first step is as long as the gap
    start = FastClock(service.clock.time_s + 60.0)
    after = replace(loop_service([FakeDriver([])], clock=start), start=keeper.snapshot)
    await serve_until(after, lambda: len(after.publisher.estimates) >= 2)
    first = after.publisher.estimates[0][1]
    gap_s = first.time_s[0] - last.time_s[0] - 60.0
    assert first.field_degC[0, 2] == pytest.approx(first.field_degC[0, 0] * gap_s)


class _Keeping(StepObserver):
    """Keeps the last snapshot."""

    snapshot = None

    def finish(self, snapshot) -> None:
        self.snapshot = snapshot


class _Departed:
    """A watch that finds a departure in whatever it is given."""

    state = None
    figures: ClassVar[dict] = {"hours": 2.0}
    departure = Departure("t2", 0.0, "steady", 2.0, 1.0)

    def __init__(self) -> None:
        self.taken = 0

    def take(self, inputs) -> None:
        self.taken += len(inputs)


async def test_a_departed_prediction_is_a_reason_and_estimates_stay_as_good_as_they_are():
    readings = [(0.05 * k, dict.fromkeys(CHANNELS, 20.0 + 0.01 * k), {}) for k in range(400)]
    gap = _Departed()
    service = loop_service([FakeDriver(readings)], gap=gap)
    reason = "the model's prediction has departed from sensor t2"
    await serve_until(
        service,
        lambda: (
            any(r.startswith(reason) for h in service.publisher.healths for r in h["reasons"])
            and any(block.quality[0] == EstimateQuality.GOOD for _, block in service.publisher.estimates)
        ),
    )
    health = service.publisher.healths[-1]
    assert health["gap"] == {"hours": 2.0}
    assert health["state"] != "good"
    assert gap.taken >= len(service.publisher.estimates)
