"""A service of small parts with a real publisher and recorder, as a process of its own.

Arguments: endpoint to connect to, folder to record into, and what hangs: nothing, step or driver.
"""

import asyncio
import sys
import time
from pathlib import Path

from observer.bus.zenoh import ServiceIdentity, ZenohPublisher
from observer.config.publishing import Publish
from observer.estimate.pipeline import Pipeline
from observer.process.clock import ServiceClock
from observer.process.shutdown import leave
from observer.record.recorder import Recorder
from observer.service.daemon import run
from observer.service.loop import Service
from tests.logs.recordings import CHANNELS, plan
from tests.service.fakes import FakeDrive, FakeDriver, FakeEstimator


class HangingEstimator(FakeEstimator):
    """Hangs in the first step that has a measurement, if it is to, without giving way to anything."""

    def __init__(self, hangs: str) -> None:
        super().__init__()
        self.hangs = hangs

    def run(self, state, inputs):
        if self.hangs == "step" and inputs.usable.any():
            print("hanging", flush=True)
            time.sleep(60)
        return super().run(state, inputs)


class Deaf(FakeDriver):
    """A driver that does not let itself be cancelled."""

    async def run(self, deliver, now) -> None:
        while True:
            try:
                await super().run(deliver, now)
            except asyncio.CancelledError:
                print("cancelled", flush=True)


def main() -> None:
    endpoint, folder, hangs = sys.argv[1:]
    estimator = HangingEstimator(hangs)
    publisher = ZenohPublisher(
        ServiceIdentity("m", "x", "0a0a0a0a"),
        Publish(mode="client", connect=(endpoint,)),
        "{}",
        estimator.layout,
    )
    recorder = Recorder(Path(folder), "m-x", CHANNELS, 1e9, 5.0)
    script = [(0.05 * k, {"t1_degC": 20.0 + k, "t2_degC": 20.0}, {}) for k in range(2000)]
    driver = (Deaf if hangs == "driver" else FakeDriver)(script)

    def notify(text: str) -> None:
        if text.startswith("READY"):
            print("ready", flush=True)
        if "WATCHDOG=1" in text:
            print("ping", flush=True)

    aligned = plan(period_s=0.1)
    pipeline = Pipeline(FakeDrive(), estimator)
    run(Service((driver,), aligned, pipeline, publisher, ServiceClock(), notify, recorder))
    print("ended", flush=True)
    leave(0)


if __name__ == "__main__":
    main()
