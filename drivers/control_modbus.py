"""A control behind Modbus TCP holding registers, in the layout of docs/how-to/compensate-registers.md.

One correction is one request, so that a control never sees half of one. No request is repeated here.
"""

from __future__ import annotations

import logging
import struct
from collections.abc import Iterator
from contextlib import contextmanager

from pymodbus.client import ModbusTcpClient
from pymodbus.exceptions import ModbusException
from pymodbus.pdu import ModbusPDU

from drivers.control import AxisCorrection, ControlError, ControlUnreachableError, ReadBack

logging.getLogger("pymodbus.logging").setLevel(logging.CRITICAL)  # `ControlError` carries it all

LAYOUT = 1
OFF, FOLLOW = 0, 1
_HEAD = struct.Struct(">HHHHIiiiii")
_STATE_AT, _STATE_WORDS = 128, 4
_FOLLOWING = 1
_REASONS = {
    1: "its dead-man has let go",
    2: "a value is beyond its limits",
    3: "it does not understand what was written",
    4: "it was switched off at the control",
}


class ModbusControlLink:
    """A control over Modbus TCP; to be used from one thread only.

    `first_register` is where the control's block of registers begins.

    Nothing is connected before `open`. Each request has one attempt, which waits at most `timeout_s`.

    Args:
        host: Name or address of the control.
        port: Its TCP port.
        unit_id: The unit that the requests address, 0 to 255.
        first_register: The transmitted register, counted from 0.
        timeout_s: The longest wait for an answer, in s.
    """

    def __init__(self, host: str, port: int, unit_id: int, first_register: int, timeout_s: float) -> None:
        self._where = f"{host}:{port}"
        self._unit_id = unit_id
        self._first = first_register
        self._client = ModbusTcpClient(host, port=port, timeout=timeout_s, retries=0, reconnect_delay=0)
        self._beat = 0
        self._words = 0

    def open(self) -> None:
        """Connect anew, and switch the control off, whatever its state was.

        Raises:
            ControlUnreachableError: If the control cannot be reached or does not answer.
            ControlError: If it answers with a Modbus exception.
        """
        self._client.close()  # type: ignore[no-untyped-call]
        self._write([LAYOUT, OFF])

    def write(self, correction: AxisCorrection, valid_s: float) -> None:
        """Make the control follow a correction, in one request, with the next number of the sign of life.

        Args:
            correction: The line and the table, both written.
            valid_s: The time, in s, that the control follows without a further write; whole milliseconds.

        Raises:
            ControlUnreachableError: If the control cannot be reached or does not answer.
            ControlError: If it answers with a Modbus exception, or a value does not fit into its registers.
        """
        self._beat = (self._beat + 1) & 0xFFFF
        count = len(correction.error_nm)
        line = (correction.reference_um, correction.offset_nm, correction.slope_nm_m)
        ends = (correction.first_um, correction.last_um)
        try:
            head = _HEAD.pack(LAYOUT, FOLLOW, self._beat, count, round(1e3 * valid_s), *line, *ends)
            table = struct.pack(f">{count}i", *correction.error_nm)
        except struct.error:
            raise ControlError(
                f"a value is too large for the control's registers at {self._where}; lower limit_um and "
                "gradient_limit_um_m in [compensation]"
            ) from None
        words = list(struct.unpack(f">{(len(head) + len(table)) // 2}H", head + table))
        self._words = len(words)
        self._write(words)

    def read_back(self) -> ReadBack:
        """Return the control's state after the last write, in two requests.

        Returns:
            What the control holds. It is not following if its state, command or number of places differs from
            what was written. A sign of life that does not advance gives a reason.

        Raises:
            ControlUnreachableError: If the control cannot be reached or does not answer.
            ControlError: If it rejects reading, or its registers have another layout or number.
        """
        words = self._read(0, self._words)
        layout, state, reason, beat = self._read(_STATE_AT, _STATE_WORDS)
        if layout != LAYOUT:
            raise ControlError(
                f"{self._where} has registers of layout {layout}, not {LAYOUT}; correct first_register in "
                "[compensation.control], or the control's program"
            )
        data = struct.pack(f">{len(words)}H", *words)
        _, command, _, count, _, reference, offset, slope, first, last = _HEAD.unpack_from(data)
        table = data[_HEAD.size :]
        error = struct.unpack(f">{len(table) // 4}i", table)
        correction = AxisCorrection(reference, offset, slope, first, last, error)
        text = _REASONS.get(reason, f"reason {reason}") if reason else None
        is_following = state == _FOLLOWING and command == FOLLOW and count == len(error)
        if is_following and beat != self._beat:
            text = text or "it does not see the sign of life advance; check that its program is running"
        return ReadBack(correction, is_following, text)

    def release(self) -> None:
        """Make the control go to zero by its own ramp, and disconnect in any case.

        Without a connection it connects once more to switch the control off.

        Raises:
            ControlUnreachableError: If the control cannot be reached or does not answer.
            ControlError: If it answers with a Modbus exception.
        """
        try:
            if self._client.connected:
                self._write([LAYOUT, OFF])
            else:
                self.open()
        finally:
            self._client.close()  # type: ignore[no-untyped-call]

    def _write(self, words: list[int]) -> None:
        with self._reached():
            answer = self._client.write_registers(self._first, words, device_id=self._unit_id)
        self._check_answer(answer, "writing")

    def _read(self, offset: int, count: int) -> list[int]:
        with self._reached():
            answer = self._client.read_holding_registers(
                self._first + offset, count=count, device_id=self._unit_id
            )
        self._check_answer(answer, "reading")
        if len(answer.registers) != count:
            raise ControlError(
                f"{self._where} was asked for {count} registers from {self._first + offset} on and gave "
                f"{len(answer.registers)}; correct the control's program"
            )
        return list(answer.registers)

    @contextmanager
    def _reached(self) -> Iterator[None]:
        """Hold a connection for one request.

        Raises `ControlUnreachableError` if there is no connection or no answer.
        """
        try:
            if not self._client.connected and not self._client.connect():  # type: ignore[no-untyped-call]
                raise ControlUnreachableError(
                    f"{self._where} cannot be reached; switch the control on, or correct host and port in "
                    "[compensation.control]"
                )
            yield
        except (OSError, ModbusException) as error:
            self._client.close()  # type: ignore[no-untyped-call]
            raise ControlUnreachableError(
                f"{self._where} does not answer ({error}); check the control, its cable, and unit_id in "
                "[compensation.control]"
            ) from None

    def _check_answer(self, answer: ModbusPDU, action: str) -> None:
        """Raise `ControlError` if the control answers with a Modbus exception; `action` is “reading” or
        “writing”.
        """
        if answer.isError():
            raise ControlError(
                f"{self._where} refuses {action} from register {self._first} on: Modbus exception "
                f"{answer.exception_code}"
            )
