"""Every fault that a driver reports has a remedy of its own."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from drivers.places import CAN_INPUTS, MODBUS_INPUTS, can_input, modbus_input
from observer.quality.alarm_classes import remedy_for

UNKNOWN = remedy_for("no_such_fault", None)


def _of_devices() -> set[str]:
    modbus = [modbus_input(device, 0) for device in MODBUS_INPUTS]
    names = {name for d in modbus for name in (*d.fault_codes.values(), *d.status_faults.values())}
    return names | {name for device in CAN_INPUTS for name in can_input(device, 0).fault_values.values()}


@pytest.mark.parametrize("fault", sorted(_of_devices()))
def test_what_a_ready_device_reports(fault):
    assert remedy_for(fault, None) != UNKNOWN


@pytest.mark.parametrize(
    "fault",
    [
        "disconnected",
        "timeout",
        "bad_reply",
        "slow_poll",
        "rtu_frames",
        "tiny_number",
        "silent",
        "short_frame",
        "not_a_number",
        "never_came",
        "end_of_log",
    ],
)
def test_what_a_wire_reports(fault):
    folders = ("drivers", "observer/align", "observer/record", "observer/live")
    source = "".join(p.read_text() for folder in folders for p in _files(folder))
    assert re.search(rf'"{fault}"', source), "no driver reports it any more"
    assert remedy_for(fault, None) != UNKNOWN


def _files(folder: str) -> list[Path]:
    return list((Path(__file__).parents[2] / folder).glob("*.py"))


def test_exceptions_by_their_number():
    assert "no such register" in str(remedy_for("exception_2", None))
    assert "rejects" in str(remedy_for("exception_99", None))


def test_nothing_wrong_needs_no_remedy_and_a_doubt_does():
    assert remedy_for(None, None) is None
    assert "scale" in str(remedy_for(None, "looks like mm"))
