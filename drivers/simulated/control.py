"""`python -m drivers.simulated.control`: a control with a compensation of its own, behind Modbus TCP.

It moves towards the commanded table at its own rate and rejects values beyond its limit. When the sign of
life stops it ramps to zero, until it has been switched off once.

It prints its port in one JSON line and ends when standard input is closed. It obeys lines on standard input
and answers each with its status. `{"alter": true}` makes it hold something other than was written, `{"off":
true}` is the operator's switch, and `{}` only queries. It shares only the page that describes the registers
with the client.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import logging
import sys
import threading
from typing import Any

from pymodbus.constants import ExcCodes
from pymodbus.server import ModbusTcpServer
from pymodbus.simulator import DataType, SimData, SimDevice

STEP_S = 0.01
REGISTERS = 256
STATE = 128
OFF, FOLLOWING, TO_ZERO = 0, 1, 2
NO_REASON, DEAD_MAN, BEYOND_LIMIT, NOT_UNDERSTOOD, SWITCHED_OFF = range(5)
WRITES = (6, 16)


def signed(high: int, low: int) -> int:
    """Return the signed 32-bit number in two registers.

    Args:
        high: The word at the lower address.
        low: The word after it.
    """
    number = high << 16 | low
    return number - (1 << 32) if number >> 31 else number


class RateLimitedTable:
    """The table in force and its target, in µm, as a control's own program would hold them.

    Args:
        rate_um_s: The largest change of each place, in µm/s.
        limit_um: The largest error that it accepts, in µm.
        longest_s: The longest validity of a sign of life, in s.

    Attributes:
        state: `OFF`, `FOLLOWING` or `TO_ZERO`.
        reason: Why it does not follow; `NO_REASON` if it may.
        beat: The last number of the sign of life.
        writes: Requests so far, rejected ones included.
        now_um: The error that it takes out at each place.
        target_um: The commanded error at each place.
        fastest_um_s: The largest rate so far.
    """

    def __init__(self, rate_um_s: float, limit_um: float, longest_s: float) -> None:
        self.rate_um_s, self.limit_um, self.longest_s = rate_um_s, limit_um, longest_s
        self.state, self.reason, self.beat, self.writes = OFF, NO_REASON, 0, 0
        self.now_um: list[float] = []
        self.target_um: list[float] = []
        self.fastest_um_s = 0.0
        self._left_s = 0.0

    def write(self, words: list[int]) -> ExcCodes | None:
        """Process a write from the first register on.

        Args:
            words: Layout, command and, to follow, the rest of docs/how-to/compensate-registers.md.

        Returns:
            None if it is accepted. `ILLEGAL_VALUE` if the request is malformed or beyond the limit,
            `DEVICE_BUSY` if the control must be switched off first.
        """
        self.writes += 1
        if len(words) >= 2 and words[:2] == [1, 0]:
            self.stop(NO_REASON)
            return None
        count = words[3] if len(words) > 3 else 0
        if words[:2] != [1, 1] or count < 2 or len(words) != 16 + 2 * count:
            self.stop(NOT_UNDERSTOOD)
            return ExcCodes.ILLEGAL_VALUE
        if self.reason != NO_REASON:  # it must be switched off first
            return ExcCodes.DEVICE_BUSY
        table_um = [signed(*words[16 + 2 * i : 18 + 2 * i]) * 1e-3 for i in range(count)]
        if max(abs(um) for um in table_um) > self.limit_um:
            self.stop(BEYOND_LIMIT)
            return ExcCodes.ILLEGAL_VALUE
        if self.state != FOLLOWING or words[2] != self.beat:
            self._left_s = min(signed(words[4], words[5]) * 1e-3, self.longest_s)
        self.state, self.beat, self.target_um = FOLLOWING, words[2], table_um
        self.now_um = self.now_um if len(self.now_um) == count else [0.0] * count
        return None

    def stop(self, reason: int) -> None:
        """Ramp to zero. Accept no table until it has been switched off, unless `reason` is `NO_REASON`."""
        self.state, self.reason = TO_ZERO, reason
        self.target_um = [0.0] * len(self.now_um)

    def advance(self, elapsed_s: float) -> None:
        """Move towards the target for `elapsed_s`, and ramp to zero if the sign of life has stopped.

        The state becomes `OFF` when a ramp to zero has ended.
        """
        self._left_s -= elapsed_s
        if self.state == FOLLOWING and self._left_s < 0.0:
            self.stop(DEAD_MAN)
        largest_um = self.rate_um_s * elapsed_s
        steps = [
            min(largest_um, max(-largest_um, b - a)) for a, b in zip(self.now_um, self.target_um, strict=True)
        ]
        self.now_um = [a + step for a, step in zip(self.now_um, steps, strict=True)]
        self.fastest_um_s = max([self.fastest_um_s, *(abs(s) / elapsed_s for s in steps)])
        if self.state == TO_ZERO and not any(self.now_um):
            self.state = OFF

    def document(self) -> dict[str, Any]:
        """Return the state as a JSON object: state, reason, tables in µm, and the largest rate in µm/s."""
        return {
            "state": self.state, "reason": self.reason, "writes": self.writes, "now_um": self.now_um,
            "wanted_um": self.target_um, "fastest_um_s": self.fastest_um_s,
        }  # fmt: skip


class ControlProcess:
    """The control and its wire.

    With a scan time it reads what was written only once a scan, as a PLC does. Otherwise it reacts at once.

    Args:
        args: The parsed command line of `main`.
    """

    def __init__(self, args: argparse.Namespace) -> None:
        self._compensation = RateLimitedTable(args.rate_um_s, args.limit_um, args.dead_man_s)
        self._port, self._scan_s = args.port, args.scan_s
        self._altered = False
        self._unread: list[list[int]] = []
        self._status: list[int] = self._state_registers()

    async def run(self) -> None:
        """Serve on loopback until standard input is closed. It prints `{"port": …}` once it listens."""
        loop = asyncio.get_running_loop()
        ended = asyncio.Event()
        block = SimData(0, values=[0] * REGISTERS, datatype=DataType.REGISTERS)
        device = SimDevice(id=1, simdata=[block], action=self._answer)
        server = ModbusTcpServer(device, address=("127.0.0.1", self._port))
        await server.serve_forever(background=True)
        port = server.transport.sockets[0].getsockname()[1]  # type: ignore[attr-defined]
        print(json.dumps({"port": port}), flush=True)

        def listen() -> None:
            for line in sys.stdin:
                loop.call_soon_threadsafe(self._obey, json.loads(line))
            loop.call_soon_threadsafe(ended.set)

        threading.Thread(target=listen, daemon=True).start()
        before_s = scanned_s = loop.time()
        while not ended.is_set():
            await asyncio.sleep(STEP_S)
            now_s = loop.time()
            self._compensation.advance(now_s - before_s)
            before_s = now_s
            if self._scan_s and now_s - scanned_s >= self._scan_s:
                scanned_s = now_s
                self._scan()
        await server.shutdown()  # type: ignore[no-untyped-call]

    def _scan(self) -> None:
        """Read the registers that were written, in order, and set the status, as a PLC does once a scan."""
        unread, self._unread = self._unread, []
        for words in unread:
            self._compensation.write(words)
        self._status = self._state_registers()

    def _state_registers(self) -> list[int]:
        compensation = self._compensation
        table = [word for um in compensation.now_um for word in divmod(round(1e3 * um) & 0xFFFFFFFF, 1 << 16)]
        largest = divmod(round(1e3 * max([0.0, *map(abs, compensation.now_um)])), 1 << 16)
        return [
            1,
            compensation.state,
            compensation.reason,
            compensation.beat,
            *largest,
            len(compensation.now_um),
            0,
            *table,
        ]

    def _obey(self, command: dict[str, Any]) -> None:
        self._altered = command.get("alter", self._altered)
        if command.get("off"):
            self._compensation.stop(SWITCHED_OFF)
        print(json.dumps(self._compensation.document()), flush=True)

    async def _answer(
        self,
        function: int,
        _first: int,
        address: int,
        _count: int,
        current: list[int],
        written: list[int] | list[bool] | None,
    ) -> ExcCodes | None:
        """Called by pymodbus before each answer."""
        compensation = self._compensation
        if function in WRITES:
            if address != 0:
                return ExcCodes.ILLEGAL_ADDRESS
            words = [int(word) for word in written or []]
            if not self._scan_s:
                return compensation.write(words)
            self._unread.append(words)
            return None
        state = self._status if self._scan_s else self._state_registers()
        current[STATE : STATE + len(state)] = state
        if self._altered:
            current[17] ^= 1
        return None


def main() -> None:
    """Start the control from the command line and return when it has ended."""
    parser = argparse.ArgumentParser(prog="python -m drivers.simulated.control", description="A control.")
    parser.add_argument("--port", type=int, default=0, help="Modbus TCP port on loopback; 0 takes a free one")
    parser.add_argument("--rate-um-s", type=float, default=5.0, help="how fast it compensates at most")
    parser.add_argument("--limit-um", type=float, default=300.0, help="what it refuses to go beyond")
    parser.add_argument("--dead-man-s", type=float, default=2.0, help="how long a sign of life holds at most")
    parser.add_argument("--scan-s", type=float, default=0.0, help="how often it reads what was written")
    logging.basicConfig(level=logging.CRITICAL)
    asyncio.run(ControlProcess(parser.parse_args()).run())


if __name__ == "__main__":
    main()
