"""How long a service lives that is to stop by itself."""

import threading

from observer.service.clock import ServiceClock
from observer.service.lives import run
from observer.service.loop import Service
from tests.service.fakes import FakeDrive, FakeDriver, FakeEstimator, FakePublisher
from tests.service.streams import plan

LIVES_S, READY_S = 0.5, 1.0


class SlowToBegin(FakeEstimator):
    """Takes longer at its first step, as one does whose kernels are compiled, than the service is to live."""

    ready = False

    def run(self, state, inputs):
        if not self.ready:
            threading.Event().wait(READY_S)
            self.ready = True
        return super().run(state, inputs)


def test_its_time_begins_with_its_first_tick():
    script = [(0.05 * k, {"t1_degC": 20.0 + k, "t2_degC": 20.0}, {}) for k in range(2000)]
    publisher, aligned = FakePublisher(), plan(period_s=0.1)
    run(
        Service(
            (FakeDriver(script),), aligned, FakeDrive(), SlowToBegin(), publisher, None, ServiceClock(), print
        ),
        LIVES_S,
    )
    assert publisher.closed
    assert publisher.estimates
