"""SIGTERM ends a whole service within two seconds in any state, and its recording is complete."""

import signal
import subprocess
import sys
import time
from contextlib import contextmanager

import pytest

from observer.logs import read_log
from observer.publish.watch import Subscription
from tests.publish.router import Router, free_port

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
        process.wait(5)
        process.stdout.close()


def _read_until(process, word: str) -> None:
    for line in process.stdout:
        if word in line.split():
            return
    raise AssertionError(f"the service ended before it said {word}")


def _terminate(process, number: int = signal.SIGTERM) -> None:
    start_s = time.monotonic()
    process.send_signal(number)
    assert process.wait(10) == 0
    assert time.monotonic() - start_s < LIMIT_S


def _recording(folder):
    (path,) = folder.glob("*.csv")
    return read_log(path)  # refuses a cut last row


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_without_a_router(tmp_path, number):
    with _service(f"tcp/127.0.0.1:{free_port()}", tmp_path) as process:
        _read_until(process, "ready")
        _terminate(process, number)
        assert "ended\n" in process.stdout.read()
    assert _recording(tmp_path).step.any()


def test_with_a_router_that_freezes(tmp_path):
    with Router() as router, _service(router.endpoint, tmp_path) as process:
        with Subscription((router.endpoint,), "m", "x") as subscription:
            end_s = time.monotonic() + 10
            while "estimate" not in subscription.latest():
                assert time.monotonic() < end_s
                time.sleep(0.02)
        router.freeze()
        time.sleep(0.3)  # some messages into the void
        _terminate(process)
        router.thaw()
    assert _recording(tmp_path).step.any()


@pytest.mark.parametrize(
    ("hangs", "word"), [("step", "hanging"), ("compile", "hanging"), ("driver", "ready")]
)
def test_with_a_part_that_hangs(tmp_path, hangs, word):
    with _service(f"tcp/127.0.0.1:{free_port()}", tmp_path, hangs) as process:
        _read_until(process, word)
        if hangs == "compile":
            time.sleep(0.5)  # readings keep coming in meanwhile
        _terminate(process)
    assert len(_recording(tmp_path)) >= 1
