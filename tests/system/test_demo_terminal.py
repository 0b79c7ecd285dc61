"""`observer demo` in a real terminal on a busy computer: right beside the truth, and cleanly ended."""

from __future__ import annotations

import os
import re
import signal
import time
from pathlib import Path

import pytest

from observer.process.shutdown import GRACE_S
from tests.bus.router import free_port
from tests.patience import PATIENCE_S, Stopwatch
from tests.system.beside_truth import SETTLED_S, SHARE, watched
from tests.system.plant import Subscriber, children_of, is_alive, until
from tests.system.terminal import CTRL_C, Terminal

pytestmark = [pytest.mark.system]

END_S = 2.0


def _endpoint() -> str:
    return f"tcp/127.0.0.1:{free_port()}"


@pytest.mark.slow
@pytest.mark.timeout(500)
def test_in_a_busy_terminal_the_heats_agree_with_the_truth():
    found = watched(SETTLED_S + 30.0)
    assert found["qualities"].get("good", 0) >= 0.8 * found["steps"] > 30, found
    assert min(found["within"].values()) >= SHARE, found


@pytest.mark.timeout(300)
def test_ctrl_c_ends_everything_and_leaves_the_terminal_as_it_was():
    endpoint = _endpoint()
    with Terminal("-m", "observer", "demo", "--listen", endpoint) as terminal:
        until(lambda: re.search("estimates: (good|starting)", terminal.shown()), 120.0)
        assert f"observer watch --connect {endpoint}" in terminal.shown()
        # the machine, the page and the view; estimates may come before the page has begun
        children = until(lambda: len(found := children_of(terminal.process.pid)) == 3 and found, 60.0)
        stopwatch = Stopwatch(terminal.process.pid, *children)
        terminal.type(CTRL_C)
        start_s = time.monotonic()
        assert stopwatch.until(lambda: terminal.process.poll() is not None) < END_S
        assert terminal.process.returncode == 0
        if time.monotonic() - start_s < GRACE_S:  # else it was left by force, and had no time to say so
            until(lambda: "demo ended" in terminal.shown())
        until(lambda: not any(is_alive(pid) for pid in children))
        terminal.assert_sane()


@pytest.mark.timeout(300)
def test_the_service_continues_without_its_view_and_says_so():
    endpoint = _endpoint()
    with (
        Terminal("-m", "observer", "demo", "--listen", endpoint) as terminal,
        Subscriber(endpoint, 120.0) as seen,
    ):
        until(lambda: re.search("estimates: (good|starting)", terminal.shown()), 120.0)
        (view,) = [pid for pid in children_of(terminal.process.pid) if b"bus.view" in _command(pid)]
        os.kill(view, signal.SIGKILL)
        until(lambda: "the view has ended" in terminal.shown(), 20.0)
        heard = len(seen.estimates)
        until(lambda: len(seen.estimates) > heard + 3, 120.0)
        terminal.type(CTRL_C)
        assert terminal.process.wait(PATIENCE_S) == 0
        terminal.assert_sane()


@pytest.mark.parametrize("sight", ["", "simulated machine: "], ids=["machine starts", "service starts"])
@pytest.mark.timeout(300)
def test_ctrl_c_while_it_starts_leaves_no_traceback(sight):
    with Terminal("-m", "observer", "demo", "--listen", _endpoint()) as terminal:
        until(lambda: children_of(terminal.process.pid) and sight in terminal.shown(), 120.0)
        terminal.type(CTRL_C)
        terminal.process.wait(PATIENCE_S)
        terminal.assert_sane()


def _command(pid: int) -> bytes:
    return Path(f"/proc/{pid}/cmdline").read_bytes()
