"""`observer demo` in a real terminal on a busy computer: right beside the truth, and cleanly ended."""

from __future__ import annotations

import json
import os
import signal
import time
from typing import Any

import numpy as np
import pytest

from tests.publish.router import free_port
from tests.system.plant import Subscriber, children_of, is_alive, until
from tests.system.terminal import CTRL_C, Terminal, busy_cores

pytestmark = [pytest.mark.system]

SETTLED_S = 60.0  # "after the first minute"
SHARE = 0.95
SIGMAS = 3.0
SERVED = {"good", "starting", "degraded"}
END_S = 2.0


def _endpoint() -> str:
    return f"tcp/127.0.0.1:{free_port()}"


def judged(documents: dict[str, list[dict[str, Any]]]) -> dict[str, Any]:
    """How many steps after the first minute were of which quality, and the share within 3 σ of each heat.

    The truth is interpolated to the time of each estimate; only steps called good are held to it.
    """
    heats, truths = documents["heat"], documents["truth/heat"]
    known_s = [truth["time_s"] for truth in truths]
    settled = [h for h in heats if h["time_s"] > heats[0]["time_s"] + SETTLED_S]
    qualities: dict[str, int] = {}
    for heat in settled:
        qualities[heat["quality"]] = qualities.get(heat["quality"], 0) + 1
    good = [h for h in settled if h["quality"] == "good"]
    within = {}
    for name in truths[0]["sources"]:
        true_W = np.interp(
            [h["time_s"] for h in good], known_s, [t["sources"][name]["heat_W"] for t in truths]
        )
        off = [
            abs(h["sources"][name]["heat_W"] - true) / h["sources"][name]["sigma_W"]
            for h, true in zip(good, true_W, strict=True)
        ]
        within[name] = float(np.mean(np.array(off) < SIGMAS)) if off else 0.0
    return {"steps": len(settled), "qualities": qualities, "within": within}


def watched(seconds: float) -> dict[str, Any]:
    """Run the demo in a terminal with a busy loop on every core for so long after its first estimate."""
    endpoint = _endpoint()
    with busy_cores(), Terminal("-m", "observer", "demo", "--listen", endpoint) as terminal:
        with Subscriber(endpoint, 300.0) as seen:
            until(lambda: "heat" in seen.documents, 300.0)
            end_s = time.monotonic() + seconds
            until(lambda: time.monotonic() > end_s or terminal.process.poll() is not None, seconds + 10.0)
            terminal.type(CTRL_C)
        assert terminal.process.wait(30.0) == 0, terminal.shown()
        terminal.assert_sane()
    found = judged(seen.documents)
    print(json.dumps(found))
    return found


@pytest.mark.timeout(500)
def test_in_a_busy_terminal_the_heats_agree_with_the_truth():
    found = watched(SETTLED_S + 30.0)
    assert found["qualities"].get("good", 0) >= 0.8 * found["steps"] > 30, found
    assert min(found["within"].values()) >= SHARE, found


@pytest.mark.slow
@pytest.mark.timeout(1200)
def test_in_a_busy_terminal_the_heats_agree_with_the_truth_for_ten_minutes():
    found = watched(600.0)
    assert found["qualities"].get("good", 0) >= 0.9 * found["steps"] > 900, found
    assert min(found["within"].values()) >= SHARE, found


@pytest.mark.timeout(300)
def test_ctrl_c_ends_everything_and_leaves_the_terminal_as_it_was():
    endpoint = _endpoint()
    with Terminal("-m", "observer", "demo", "--listen", endpoint) as terminal:
        until(lambda: "quality good" in terminal.shown() or "quality starting" in terminal.shown(), 120.0)
        assert f"observer watch --connect {endpoint}" in terminal.shown()
        children = children_of(terminal.process.pid)
        assert len(children) == 2  # the machine and the view
        terminal.type(CTRL_C)
        start_s = time.monotonic()
        assert terminal.process.wait(20.0) == 0
        took_s = time.monotonic() - start_s
        until(lambda: not any(is_alive(pid) for pid in children), 5.0)
        assert took_s < END_S
        assert "demo ended" in terminal.shown()
        terminal.assert_sane()


@pytest.mark.timeout(300)
def test_the_service_goes_on_without_its_view_and_says_so():
    endpoint = _endpoint()
    with (
        Terminal("-m", "observer", "demo", "--listen", endpoint) as terminal,
        Subscriber(endpoint, 120.0) as seen,
    ):
        until(lambda: "quality good" in terminal.shown() or "quality starting" in terminal.shown(), 120.0)
        (view,) = [pid for pid in children_of(terminal.process.pid) if _command(pid).count(b"observer.view")]
        os.kill(view, signal.SIGKILL)
        until(lambda: "the view has ended" in terminal.shown(), 20.0)
        heard = len(seen.estimates)
        until(lambda: len(seen.estimates) > heard + 3, 120.0)
        terminal.type(CTRL_C)
        assert terminal.process.wait(20.0) == 0
        terminal.assert_sane()


@pytest.mark.parametrize("sight", ["", "simulated machine: "], ids=["machine starts", "service starts"])
@pytest.mark.timeout(300)
def test_ctrl_c_while_it_starts_leaves_no_traceback(sight):
    with Terminal("-m", "observer", "demo", "--listen", _endpoint()) as terminal:
        until(lambda: children_of(terminal.process.pid) and sight in terminal.shown(), 120.0)
        terminal.type(CTRL_C)
        terminal.process.wait(30.0)
        terminal.assert_sane()


def _command(pid: int) -> bytes:
    with open(f"/proc/{pid}/cmdline", "rb") as file:
        return file.read()
