"""How long a service lives that is to stop by itself."""

import time
from dataclasses import dataclass, field

from observer.daemon import run
from observer.exchange import PublishStatus
from observer.process.clock import ServiceClock
from tests.live.fakes import FakeDriver, FakePublisher, fake_service
from tests.logs.recordings import plan

LIVES_S, READY_S = 0.5, 1.0


@dataclass
class SlowToSettle(FakePublisher):
    """Takes longer to know who else is there than the service is to live."""

    begun_s: float = field(default_factory=time.monotonic)

    @property
    def status(self) -> PublishStatus:
        settled = time.monotonic() - self.begun_s > READY_S
        return PublishStatus(True, len(self.estimates), 0, 0, None, settled=settled)


def test_its_time_begins_with_its_first_tick():
    script = [(0.05 * k, {"t1_degC": 20.0 + k, "t2_degC": 20.0}, {}) for k in range(2000)]
    publisher, aligned = SlowToSettle(), plan(period_s=0.1)
    run(
        fake_service((FakeDriver(script),), aligned, ServiceClock(), publisher=publisher),
        LIVES_S,
    )
    assert publisher.closed
    assert publisher.estimates
