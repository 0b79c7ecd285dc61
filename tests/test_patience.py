"""The tests' own rules: they wait for events, and time what is claimed without the computer's hold-ups."""

from __future__ import annotations

import ast
import asyncio
import os
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests import patience
from tests.patience import Stopwatch, computed_s, eventually, until

ROOT = Path(__file__).parents[1]
# Where a test sleeps, and why it does not wait for an event there.
SLEEPS = {
    "patience.py until": "between two looks",
    "patience.py eventually": "between two looks",
    "drivers/harness.py Device._answer": "the device is slow to answer",
    "test_patience.py test_an_example_may_last_longer_than_hypothesis_allows_by_itself": "on a busy computer",
    "drivers/test_can.py _overwhelm": "the event loop is busy",
    "outlets/test_mqtt_late.py _feed": "steps have a period",
    "live/process.py HangingEstimator.run": "the step hangs",
    "drivers/test_can.py test_a_burst_of_an_adapter_that_stamps_is_spread_as_it_was_on_the_wire": "busy",
    "drivers/test_can.py test_frames_that_wait_for_a_busy_program_have_the_times_of_their_sending": "frames "
    "are sent at times of their own",
    "drivers/test_can.py test_frames_that_wait_for_a_busy_program_have_the_times_of_their_sending.now": "the "
    "thread that receives is held up",
    "drivers/agent.py Handler._drip": "an answer comes letter by letter",
    "drivers/test_player.py test_rows_handed_on_late_have_the_times_at_which_they_were_due": "busy",
    "drivers/slave.py Slave.answer": "the device is slow to answer",
    "drivers/test_simulated_mishaps.py test_hold_ups_come_again_and_again": "frames have a period",
    "drivers/test_simulated_process.py test_it_is_where_it_would_have_been_after_a_hold_up": "it "
    "is held up for so long",
    "live/fakes.py FakeDriver.run": "readings come at the times of a script",
    "live/test_wires.py Talking.run": "readings have a period",
    "live/test_wires.py test_a_busy_event_loop_delays_no_reading": "the event loop is busy",
    "live/test_wires.py test_readings_that_nobody_takes_are_counted_as_drops": "the event loop is busy",
    "mutants/forks.py _run": "a fork has no other way to be waited for with a bound",
    "soak/__main__.py _watch": "figures have a period",
}


def sleeps(node: ast.AST, place: str = "") -> Iterator[str]:
    """The functions in which something sleeps; sleeping for 0 s only gives way to others."""
    if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef):
        place = f"{place}.{node.name}".removeprefix(".")
    if isinstance(node, ast.Call):
        name = ast.unparse(node.func).rpartition(".")[2]
        if name == "sleep" and [ast.unparse(argument) for argument in node.args] != ["0"]:
            yield place
    for child in ast.iter_child_nodes(node):
        yield from sleeps(child, place)


def test_tests_sleep_nowhere_else():
    """Wait with `until` or `eventually` of `tests/patience.py`, or say above why a test sleeps."""
    found = {
        f"{path.relative_to(ROOT / folder)} {place}"
        for folder in ("tests", "campaigns")
        for path in (ROOT / folder).rglob("*.py")
        for place in sleeps(ast.parse(path.read_text(encoding="utf-8")))
    }
    assert found == SLEEPS.keys()


@pytest.mark.parametrize(
    ("code", "places"),
    [
        ("async def a():\n    await asyncio.sleep(0.1)", ["a"]),
        ("class A:\n    def b(self):\n        while x:\n            time.sleep(T_S)", ["A.b"]),
        ("from time import sleep\nsleep(1)", [""]),
        ("async def a():\n    await asyncio.sleep(0)", []),
    ],
)
def test_a_sleep_is_seen(code, places):
    assert list(sleeps(ast.parse(code))) == places


def test_what_never_comes_is_reported_and_what_comes_is_returned(monkeypatch):
    monkeypatch.setattr(patience, "PATIENCE_S", 0.02)
    with pytest.raises(AssertionError, match=r"not within 0\.02 s"):
        until(lambda: False, 0.01)
    looks = iter([None, [], "there"])
    assert until(lambda: next(looks)) == "there"


async def test_the_event_loop_continues_meanwhile():
    there = threading.Event()
    asyncio.get_running_loop().call_later(0.01, there.set)
    assert await eventually(there.is_set)


@pytest.mark.system
def test_a_pause_is_timed_in_full():
    """Of a process with one thread: on a busy computer a test's other threads stand in the queue."""
    with subprocess.Popen(["sleep", "600"]) as process:
        try:
            until(lambda: _sleeps(process.pid))
            watch = Stopwatch(process.pid)
            begin_s = time.monotonic()
            threading.Event().wait(0.1)
            assert watch.took_s() > 0.09
            assert watch.took_s() + watch.held_up_s() >= time.monotonic() - begin_s - 0.01
        finally:
            process.kill()


def _sleeps(pid: int) -> bool:
    """Whether the program has been loaded and waits."""
    if not Path(f"/proc/{pid}/cmdline").read_bytes().startswith(b"sleep"):
        return False
    return Path(f"/proc/{pid}/stat").read_text(encoding="utf-8").rsplit(")", 1)[1].split()[0] == "S"


@contextmanager
def _one_processor_shared_with(count: int) -> Iterator[None]:
    """This process on one processor, beside so many others that never pause."""
    processors = os.sched_getaffinity(0)
    os.sched_setaffinity(0, {min(processors)})
    others = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(count)]
    try:
        until(lambda: all(computed_s(other.pid) > 0.1 for other in others))
        yield
    finally:
        for other in others:
            other.kill()
            other.wait()
        os.sched_setaffinity(0, processors)


@pytest.mark.system
def test_the_time_that_others_have_the_processor_is_left_out():
    with _one_processor_shared_with(2):
        watch, start_s = Stopwatch(), time.monotonic()
        begin_s = computed_s(os.getpid())
        while computed_s(os.getpid()) < begin_s + 0.3:
            pass
        lasted_s, took_s = time.monotonic() - start_s, watch.took_s()
    assert lasted_s > 0.6
    assert 0.2 < took_s < 0.45


@settings(max_examples=3)
@given(st.floats(0.25, 0.3))
def test_an_example_may_last_longer_than_hypothesis_allows_by_itself(seconds: float) -> None:
    time.sleep(seconds)
