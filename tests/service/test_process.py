"""SIGTERM ends a whole service within two seconds in any state, and its recording is complete."""

import signal
import subprocess
import sys
from contextlib import contextmanager

import pytest

from observer.bus.watch import Subscription
from observer.files.logs import read_log
from tests.bus.router import Router, free_port
from tests.patience import PATIENCE_S, Stopwatch, until

pytestmark = pytest.mark.system
LIMIT_S = 2.0


@contextmanager
def _service(endpoint: str, folder, hangs: str = "nothing"):
    process = subprocess.Popen(
        [sys.executable, "-m", "tests.service.process", endpoint, str(folder), hangs],
        stdout=subprocess.PIPE,
        text=True,
    )
    try:
        yield process
    finally:
        process.kill()
        process.wait(PATIENCE_S)
        process.stdout.close()


def _read_until(process, word: str) -> None:
    for line in process.stdout:
        if word in line.split():
            return
    raise AssertionError(f"the service ended before it said {word}")


def _terminate(process, number: int = signal.SIGTERM) -> None:
    watch = Stopwatch(process.pid)
    process.send_signal(number)
    assert watch.until(lambda: process.poll() is not None) < LIMIT_S
    assert process.returncode == 0


def _recording(folder):
    (path,) = folder.glob("*.csv")
    return read_log(path)  # refuses a cut last row


def _wait_for_rows(folder, count: int) -> None:
    """Wait for so many more rows of the recording."""

    def rows() -> int:
        return sum(path.read_bytes().count(b"\n") for path in folder.glob("*.csv"))

    before = rows()
    until(lambda: rows() >= before + count)


def test_a_service_whose_router_freezes_ends_within_two_seconds(tmp_path):
    with Router() as router, _service(router.endpoint, tmp_path) as process:
        with Subscription((router.endpoint,), "m", "x") as subscription:
            until(lambda: "estimate" in subscription.latest())
        router.freeze()
        _wait_for_rows(tmp_path, 10)  # some messages into the void
        _terminate(process)
        router.thaw()
    assert _recording(tmp_path).step.any()


@pytest.mark.parametrize(("hangs", "word"), [("step", "hanging"), ("driver", "ready")])
def test_a_service_with_a_part_that_hangs_ends_within_two_seconds(tmp_path, hangs, word):
    with _service(f"tcp/127.0.0.1:{free_port()}", tmp_path, hangs) as process:
        _read_until(process, word)
        _terminate(process)
    assert len(_recording(tmp_path)) >= 1
