"""The tables of alarms and faults are complete: remedies, pages, and names that can be switched off."""

from __future__ import annotations

import re
from pathlib import Path
from typing import get_args

import pytest

from drivers.places import CAN_INPUTS, MODBUS_INPUTS, can_input, modbus_input
from observer.config.publishing import AlarmKind
from observer.quality.alarm_classes import ALARM_CLASSES, remedy_for
from observer.quality.alarm_states import AlarmCause

ROOT = Path(__file__).parents[2]
UNKNOWN = remedy_for("no_such_fault", None)


def _of_devices() -> set[str]:
    modbus = [modbus_input(device, 0) for device in MODBUS_INPUTS]
    names = {name for d in modbus for name in (*d.fault_codes.values(), *d.status_faults.values())}
    return names | {name for device in CAN_INPUTS for name in can_input(device, 0).fault_values.values()}


@pytest.mark.parametrize("fault", sorted(_of_devices()))
def test_every_fault_of_a_ready_device_has_a_remedy(fault):
    assert remedy_for(fault, None) != UNKNOWN


WIRES = ["disconnected", "timeout", "bad_reply", "slow_poll", "rtu_frames", "tiny_number", "silent",
         "short_frame", "not_a_number", "never_came", "end_of_log"]  # fmt: skip


@pytest.mark.parametrize("fault", WIRES)
def test_every_fault_of_a_wire_is_reported_and_has_a_remedy(fault):
    folders = ("drivers", "observer/align", "observer/record", "observer/service")
    source = "".join(path.read_text() for folder in folders for path in (ROOT / folder).glob("*.py"))
    assert re.search(rf'"{fault}"', source), "no driver reports it any more"
    assert remedy_for(fault, None) != UNKNOWN


def test_a_modbus_exception_has_the_remedy_of_its_number():
    assert "no such register" in str(remedy_for("exception_2", None))
    assert "rejects" in str(remedy_for("exception_99", None))


def test_an_implausible_value_has_a_remedy_and_a_good_one_none():
    assert remedy_for(None, None) is None
    assert "scale" in str(remedy_for(None, "looks like mm"))


def test_the_pages_list_every_class_of_alarms():
    troubleshoot = (ROOT / "docs/how-to/troubleshoot.md").read_text(encoding="utf-8")
    page = (ROOT / "docs/explanation/alarms.md").read_text(encoding="utf-8")
    for name, kind in ALARM_CLASSES.items():
        assert kind.remedy
        assert re.search(rf"^\| `{name}` \| \S", troubleshoot, re.MULTILINE)
        latched = "yes" if kind.latched else "no"
        assert f"| `{name}` | {kind.severity} | {kind.on_s:g} | {kind.off_s:g} | {latched} |" in page


def test_every_class_of_alarms_can_be_switched_off():
    assert set(get_args(AlarmKind)) == set(ALARM_CLASSES)


def test_the_id_of_an_alarm_is_fit_for_a_key():
    assert AlarmCause("wire", "fräse/x*", "gone").id == "wire.fr_se_x_"
