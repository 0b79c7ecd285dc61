"""How long a service lives that is to stop by itself."""

import time
from dataclasses import dataclass, field

from observer.bus.exchange import PublishStatus
from observer.service.daemon import run
from tests.service.fakes import FakeDriver, FakePublisher, loop_service

LIVES_S, READY_S = 0.5, 1.0


@dataclass
class SlowToSettle(FakePublisher):
    """Takes longer to know who else is there than the service is to live."""

    begun_s: float = field(default_factory=time.monotonic)

    @property
    def status(self) -> PublishStatus:
        settled = time.monotonic() - self.begun_s > READY_S
        return PublishStatus(True, len(self.estimates), 0, 0, None, settled=settled)


def test_the_time_of_a_service_begins_with_its_first_tick():
    script = [(0.05 * k, {"t1_degC": 20.0 + k, "t2_degC": 20.0}, {}) for k in range(2000)]
    publisher = SlowToSettle()
    run(loop_service((FakeDriver(script),), publisher=publisher), LIVES_S)
    assert publisher.closed
    assert publisher.estimates
