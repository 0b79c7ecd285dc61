"""Drivers in a thread of their own: order, drops, restarts, deaths and hanging ones."""

import asyncio
import contextlib
import threading
import time

from drivers.protocol import DriverStatus
from observer.frames import Reading
from observer.service import wires as wires_module
from observer.service.wires import Wires
from tests.patience import eventually as until
from tests.service.fakes import FakeDriver, loop_service, serve_until


class Talking(FakeDriver):
    """Delivers a number every few milliseconds, with the time at which it did."""

    async def run(self, deliver, now):
        self.runs += 1
        self.thread = threading.current_thread()
        for number in range(10**9):
            deliver(Reading(now(), {"t1_degC": float(number)}))
            await asyncio.sleep(0.002)


class Hanging(FakeDriver):
    """Blocks its event loop, as a library with a defect might, until `let_go`."""

    let_go = threading.Event()

    async def run(self, deliver, now):
        self.let_go.clear()
        self.let_go.wait(30.0)


@contextlib.contextmanager
def started(*drivers):
    taken = []
    wires = Wires(drivers, time.monotonic, lambda name, reading: taken.append((name, reading)))
    wires.start()
    try:
        yield wires, taken
    finally:
        wires.close(5.0)


async def test_readings_come_in_order_on_the_loop_that_started_and_none_is_lost():
    with started(driver := Talking([])) as (wires, taken):
        await until(lambda: len(taken) >= 50)
        assert driver.thread is not threading.current_thread()
    assert wires.close(1.0)
    assert [reading.values["t1_degC"] for _, reading in taken] == list(range(len(taken)))


async def test_a_busy_event_loop_delays_no_reading():
    """The main loop is held up for a second; what the driver read then has the times of then."""
    with started(Talking([])) as (_, taken):
        await until(lambda: taken)
        seen = len(taken)
        begin_s = time.monotonic()
        time.sleep(1.0)
        end_s = time.monotonic()
        await until(lambda: taken[-1][1].time_s > end_s)
        within = [r for _, r in taken[seen:] if begin_s < r.time_s < end_s]
    assert len(within) > 20  # of 500, on a computer with other things to do


async def test_readings_that_nobody_takes_are_counted_as_drops(monkeypatch):
    monkeypatch.setattr(wires_module, "MAX_WAITING", 5)
    with started(driver := Talking([], status=DriverStatus(drops=3))) as (wires, taken):
        await until(lambda: taken)
        end_s = time.monotonic() + 20.0
        while wires.statuses()[driver.name].drops <= 3 and time.monotonic() < end_s:
            time.sleep(0.01)  # this event loop is not to run
        assert wires.statuses()[driver.name].drops > 3
        assert driver.status.drops == 3


async def test_a_driver_that_does_not_end_is_left_behind():
    hanging = Hanging([])
    with started(hanging) as (wires, _):
        start_s = time.monotonic()
        assert not wires.close(0.3)
        assert time.monotonic() - start_s < 3.0
        hanging.let_go.set()


async def test_a_thread_of_drivers_that_hangs_is_not_alive(monkeypatch):
    monkeypatch.setattr(wires_module, "_DEAF_S", 0.2)
    hanging = Hanging([])
    with started(hanging) as (wires, _):
        await until(lambda: not wires.alive)
        hanging.let_go.set()


async def test_a_dead_thread_of_drivers_ends_the_pings_of_the_watchdog():
    class Deadly(FakeDriver):
        async def run(self, deliver, now):
            await asyncio.to_thread(ready.wait, 20.0)
            asyncio.get_running_loop().stop()  # as an exception would that is none of an application's

    ready = threading.Event()
    service = loop_service([Deadly([])], period_s=0.05)
    before = []

    def stopped_pinging():
        if len(service.notes) >= 2:
            ready.set()
        before.append((len(service.publisher.estimates), len(service.notes)))
        estimates, notes = before[-1]
        return any(n == notes and estimates - e >= 5 for e, n in before)

    await serve_until(service, stopped_pinging, timeout_s=30.0)


async def test_a_reading_that_is_late_keeps_its_time_and_one_far_too_late_is_a_fault():
    class Late(FakeDriver):
        async def run(self, deliver, now):
            start_s = now()
            for back_s in (0.0, 0.5, 0.99, 2.0):
                deliver(Reading(start_s - back_s, {"t1_degC": back_s}))
            await asyncio.Event().wait()

    class Recorder:
        status = None
        alive = True
        readings: list = []  # noqa: RUF012

        def reading(self, used):
            self.readings.append(used)

        def tick(self, time_s, standing):
            pass

        def close(self, timeout_s):
            return True

    service = loop_service([Late([])], recorder=Recorder())

    def faults_seen():
        return [health["channels"]["t1_degC"]["fault"] for health in service.publisher.healths]

    await serve_until(service, lambda: "time_backwards" in faults_seen())
    faults = [reading.faults for reading in Recorder.readings]
    assert faults == [{}, {}, {}, {"t1_degC": "time_backwards"}]
