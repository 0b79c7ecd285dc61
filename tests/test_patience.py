"""The tests' own rule: they wait for events, and say why where they sleep instead."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).parents[1]
# Where a test sleeps, and why it does not wait for an event there.
SLEEPS = {
    "patience.py until": "between two looks",
    "patience.py eventually": "between two looks",
    "drivers/harness.py Device._answer": "the device is slow to answer",
    "drivers/test_can.py _overwhelm": "the event loop is busy",
    "service/process.py HangingEstimator.run": "the step hangs",
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
    "service/fakes.py FakeDriver.run": "readings come at the times of a script",
    "service/test_wires.py Talking.run": "readings have a period",
    "service/test_wires.py test_a_busy_event_loop_delays_no_reading": "the event loop is busy",
    "service/test_wires.py test_readings_that_nobody_takes_are_counted_as_drops": "the event loop is busy",
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
