"""The thread that writes to a control, against a control in a process of its own."""

from __future__ import annotations

import signal
import struct
import time

import pytest
from pymodbus.client import ModbusTcpClient

from drivers.control_modbus import ModbusControlLink
from observer.control.steering import Steering, correction_of
from tests.control.a_control import simulated_control
from tests.patience import Stopwatch, until

pytestmark = pytest.mark.system
VALID_S = 0.5
RATE_UM_S = 100.0
FOLLOW_S = 0.3
OFF = {"armed": False, "error_um": None}


def document(*error_um: float) -> dict[str, object]:
    """An armed document of a table."""
    count = len(error_um)
    return {
        "armed": True, "reference_m": 0.5, "offset_um": 1.25, "slope_um_m": -3.5,
        "position_m": [0.2 + 0.6 * i / (count - 1) for i in range(count)], "error_um": list(error_um),
    }  # fmt: skip


def steering(port: int, valid_s: float = VALID_S) -> Steering:
    return Steering(ModbusControlLink("127.0.0.1", port, 1, 0, 0.3), valid_s, FOLLOW_S)


def hold(steered: Steering, payload: dict[str, object], wanted, timeout_s: float = 10.0) -> None:
    """Pass the same document each 50 ms, as the loop does, until `wanted()` holds."""

    def look():
        steered.take(payload)
        return wanted()

    until(look, timeout_s)


def test_a_correction_is_in_the_controls_whole_numbers():
    found = correction_of(document(10.0, -20.0005, 30.0))
    assert (found.reference_um, found.offset_nm, found.slope_nm_m) == (500_000, 1250, -3500)
    assert (found.first_um, found.last_um) == (200_000, 800_000)
    assert found.error_nm == (10_000, -20_000, 30_000)


def test_an_armed_table_is_followed_at_the_controls_rate_and_released_when_off():
    with simulated_control("--rate-um-s", "100") as control:
        steered = steering(control.port)
        for _ in range(20):
            steered.take(OFF)
        assert control.status()["writes"] == 0  # never, while it is not armed
        table = document(10.0, -20.0, 30.0)
        hold(steered, table, lambda: control.largest_um >= 30.0)
        status = control.status()
        assert status["now_um"] == pytest.approx([10.0, -20.0, 30.0])
        assert status["fastest_um_s"] <= RATE_UM_S * (1 + 1e-9)
        assert steered.failure is None
        watch = Stopwatch()
        hold(steered, table, lambda: watch.took_s() > 3 * VALID_S)  # its sign of life advances
        assert (control.largest_um, steered.failure) == (30.0, None)
        with ModbusTcpClient("127.0.0.1", port=control.port) as reader:  # the registers of the page
            words = reader.read_holding_registers(0, count=22, device_id=1).registers
        head = struct.unpack(">HHHHIiiiii", struct.pack(">16H", *words[:16]))
        assert head[:2] == (1, 1)
        assert head[3:] == (3, 500, 500_000, 1250, -3500, 200_000, 800_000)
        assert struct.unpack(">3i", struct.pack(">6H", *words[16:])) == (10_000, -20_000, 30_000)

        steered.take(OFF)
        until(lambda: control.largest_um == 0.0)
        status = control.status()
        assert (status["state"], status["reason"]) == (0, 0)  # released, not let go by the dead-man
        steered.take(OFF)
        assert control.status()["writes"] == status["writes"]
        hold(steered, table, lambda: control.largest_um >= 30.0)  # and again
        assert steered.close(1.0)
        until(lambda: control.largest_um == 0.0)
        assert control.status()["reason"] == 0


def test_a_stalled_loop_is_released_by_the_dead_man_although_the_thread_lives():
    with simulated_control() as control:
        steered = steering(control.port)
        hold(steered, document(3.0, 3.0), lambda: control.largest_um >= 3.0)
        watch = Stopwatch()
        until(lambda: control.status()["reason"] == 1)
        assert watch.took_s() < VALID_S + 0.5
        until(lambda: control.largest_um == 0.0)
        hold(steered, document(3.0, 3.0), lambda: steered.failure is not None)
        assert steered.failure == "control: it does not follow: its dead-man has let go"
        assert steered.close(1.0)


@pytest.mark.parametrize(
    ("command", "table", "why"),
    [
        ({"alter": True}, (1.0, 2.0), "reads back something other than was written"),
        ({"off": True}, (1.0, 2.0), "switched off at the control"),
        ({}, (1.0, 400.0), "refuses writing from register 0 on: Modbus exception 3"),
        ({}, (1.0, 1e9), "too large for the control's registers"),
    ],
)
def test_a_control_that_does_not_obey_is_released_with_the_reason(command, table, why):
    with simulated_control() as control:
        steered = steering(control.port)
        hold(steered, document(1.0, 2.0), lambda: control.largest_um >= 2.0)
        control.command(**command)
        hold(steered, document(*table), lambda: steered.failure is not None)
        assert why in steered.failure
        until(lambda: control.largest_um == 0.0)
        control.command(alter=False)
        writes = until(lambda: control.status()["writes"])
        steered.take(document(1.0, 2.0))
        assert why in steered.failure  # it stays, until it was off once
        assert control.status()["writes"] == writes
        steered.take(OFF)
        hold(steered, document(1.0, 2.0), lambda: control.largest_um >= 2.0)
        assert steered.failure is None
        assert steered.close(1.0)


def test_a_control_that_is_gone_or_hangs_never_blocks_the_caller():
    with simulated_control() as control:
        steered = steering(control.port)
        hold(steered, document(1.0, 2.0), lambda: control.largest_um >= 2.0)
        control.process.send_signal(signal.SIGSTOP)
        slowest_s = 0.0

        def take() -> bool:
            nonlocal slowest_s
            watch = Stopwatch()
            steered.take(document(1.0, 2.0))
            slowest_s = max(slowest_s, watch.took_s())
            return steered.failure is not None

        until(take)
        assert slowest_s < 0.1  # a time-out of the wire is 0.3 s
        assert "does not answer" in steered.failure
        control.process.send_signal(signal.SIGCONT)
        steered.take(OFF)
        hold(steered, document(1.0, 2.0), lambda: control.largest_um >= 2.0)
    hold(steered, document(1.0, 2.0), lambda: steered.failure is not None)
    steered.take(OFF)
    hold(steered, document(1.0, 2.0), lambda: "cannot be reached" in str(steered.failure))
    assert steered.close(2.0)


class _OffBetween(ModbusControlLink):
    """The operator switches it off after it was looked at and before it is written to."""

    control = None

    def write(self, correction, valid_s):
        if self.control is not None:
            self.control.command(off=True)
        super().write(correction, valid_s)


def test_a_rejected_write_is_reported_with_the_controls_own_reason():
    with simulated_control() as control:
        between = _OffBetween("127.0.0.1", control.port, 1, 0, 0.3)
        steered = Steering(between, VALID_S, FOLLOW_S)
        hold(steered, document(1.0, 2.0), lambda: control.largest_um >= 2.0)
        between.control = control
        hold(steered, document(1.0, 2.0), lambda: steered.failure is not None)
        assert "from register 0 on: Modbus exception 6; it was switched off at the control" in steered.failure
        assert steered.close(1.0)


@pytest.mark.parametrize("scan_s", [0.015, 0.1, 0.2])
def test_a_control_that_sets_its_status_in_its_next_scan_follows(scan_s):
    with simulated_control("--rate-um-s", "100", "--scan-s", str(scan_s), "--dead-man-s", "20") as control:
        steered = steering(control.port, valid_s=5.0)
        steered.take(document(1.0, 2.0))
        assert steered.is_pending  # nobody can know yet
        hold(steered, document(1.0, 2.0), lambda: control.largest_um >= 2.0 or steered.failure)
        until(lambda: not steered.is_pending)
        for step in range(20):  # also with each later table
            table = document(1.0, 2.0 + 0.01 * step)
            steered.take(table)
            until(lambda um=2.0 + 0.01 * step: control.largest_um >= um - 1e-9 or steered.failure)
        assert steered.failure is None
        assert steered.close(1.0)


def test_a_control_that_never_follows_is_reported_after_the_time_it_was_given():
    with simulated_control("--scan-s", "1000") as control:
        steered = steering(control.port, valid_s=5.0)
        taken_s = time.monotonic()
        steered.take(document(1.0, 2.0))
        until(lambda: not steered.is_pending)
        assert time.monotonic() - taken_s >= FOLLOW_S
        assert steered.failure == "control: it does not follow: it is off"
        steered.take(OFF)
        assert steered.close(1.0)


def test_a_control_that_is_out_of_reach_for_less_than_a_document_holds_keeps_following():
    with simulated_control("--dead-man-s", "20") as control:
        steered = steering(control.port, valid_s=20.0)
        hold(steered, document(1.0, 2.0), lambda: control.largest_um >= 2.0)
        control.process.send_signal(signal.SIGSTOP)
        watch = Stopwatch()
        hold(steered, document(1.0, 2.0), lambda: watch.took_s() > 1.0)  # three requests time out
        control.process.send_signal(signal.SIGCONT)
        hold(steered, document(1.0, 3.0), lambda: control.largest_um >= 3.0)
        assert steered.failure is None
        assert control.status()["state"] == 1
        assert steered.close(1.0)
