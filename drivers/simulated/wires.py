"""The simulated machine's wires: Modbus TCP for its thermocouples, CAN on a pty, Zenoh for its truth."""

from __future__ import annotations

import contextlib
import json
import os
import select
import threading
import time
import tty
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

import cantools
import zenoh
from pymodbus.constants import ExcCodes
from pymodbus.server import ModbusTcpServer
from pymodbus.simulator import DataType, SimData, SimDevice

from drivers.simulated.faults import Faults, Mishaps
from drivers.simulated.machine import TrueHeats

RETRY_S = 0.25
WAGO_OPEN, WAGO_OVER = 0x60, 0x42


def wago_750_458(temperature_degC: Mapping[str, float], faults: Faults) -> list[int]:
    """Return the registers of a WAGO 750-458: for each input a status word, then tenths of a degree.

    Args:
        temperature_degC: The readings in °C, by name, in the order of the inputs.
        faults: Thermocouples in `open` and `over_range` get the module's status and clamped value.
    """
    registers: list[int] = []
    for name, value in temperature_degC.items():
        status, tenths = 0, round(10 * value)
        if name in faults.open:
            status, tenths = WAGO_OPEN, 0x7FFF
        elif name in faults.over_range:
            status, tenths = WAGO_OVER, 13000
        registers += [status, tenths & 0xFFFF]
    return registers


def icpdas_m7018(temperature_degC: Mapping[str, float], faults: Faults) -> list[int]:
    """Return the registers of an ICP DAS M-7018: tenths of a degree.

    A broken wire is the only fault it reports, as 0x7FFF.

    Args:
        temperature_degC: The readings in °C, by name, in the order of the inputs.
        faults: Thermocouples in `open` get that code.
    """
    return [
        0x7FFF if name in faults.open else round(10 * value) & 0xFFFF
        for name, value in temperature_degC.items()
    ]


class ThermocoupleServer:
    """A Modbus TCP server on loopback; it keeps the `port` it got when it is dropped and restored.

    Attributes:
        port: The TCP port; 0 until `start` has taken a free one.
        registers: The present values, unsigned 16-bit; replace them at any time on the event loop's thread.
        exception: The Modbus exception code of every answer; None for answers.
    """

    def __init__(self, port: int, registers: list[int]) -> None:
        self.port = port
        self.registers = registers
        self.exception: int | None = None
        self._server: ModbusTcpServer | None = None

    async def start(self) -> None:
        """Begin to listen in the running event loop, as unit 1.

        Raises:
            OSError: If another program has the port.
        """
        block = SimData(0, values=list(self.registers), datatype=DataType.REGISTERS)
        device = SimDevice(id=1, simdata=[block], action=self._answer)
        self._server = ModbusTcpServer(device, address=("127.0.0.1", self.port))
        await self._server.serve_forever(background=True)
        self.port = self._server.transport.sockets[0].getsockname()[1]  # type: ignore[attr-defined]

    async def stop(self) -> None:
        """Close the port and every connection. A second call has no effect."""
        if self._server is not None:
            await self._server.shutdown()  # type: ignore[no-untyped-call]
            self._server = None

    async def set_listening(self, listening: bool) -> None:
        """Drop the server, or bring it back on the same port."""
        if listening and self._server is None:
            await self.start()
        elif not listening:
            await self.stop()

    async def _answer(
        self,
        _function: int,
        _first: int,
        _address: int,
        _count: int,
        current: list[int],
        _written: list[int] | list[bool] | None,
    ) -> ExcCodes | None:
        """Called by pymodbus before each answer: put the latest values in, or refuse."""
        if self.exception is not None:
            return ExcCodes(self.exception)
        current[: len(self.registers)] = self.registers
        return None


def _hung_up(master: int) -> bool:
    """Whether no process has the device of this master open."""
    poll = select.poll()
    poll.register(master, 0)
    return any(event & select.POLLHUP for _, event in poll.poll(0))


class AxisBus:
    """The axis controller's cyclic frame, described by `axis.dbc`, on the `device` of a serial CAN adapter.

    With `stamps`, each line ends with the adapter's milliseconds. While no process has the device open, lines
    are dropped, as on a wire. So a process that opens it later receives no old frames.

    Attributes:
        device: The path of the pseudo-terminal that a driver opens as a serial adapter.
        mishaps: What happens to status frames on their way.
    """

    def __init__(self, stamps: bool, seed: int) -> None:
        database = cantools.database.load_file(Path(__file__).parent / "axis.dbc")
        self._message = database.get_message_by_name("AxisStatus")  # type: ignore[union-attr]
        self._probed = database.get_message_by_name("ProbeResult")  # type: ignore[union-attr]
        self._master, slave = os.openpty()
        tty.setraw(slave)
        os.set_blocking(self._master, False)
        self.device = os.ttyname(slave)
        os.close(slave)  # from now on the master sees a hang-up until somebody opens the device
        self._stamps = stamps
        self._alive = 0
        self.mishaps = Mishaps(self._write, seed)

    def send(self, nut_position_m: float, screw_speed_rpm: float, period_s: float) -> None:
        """Send one status frame, the next of which comes a period later.

        Args:
            nut_position_m: Position of the nut in m.
            screw_speed_rpm: Speed of the screw in rpm; 0 sends the axis state 1, standing.
            period_s: The interval of the frames in s, for faults that happen at random.
        """
        self._alive = (self._alive + 1) % 256
        signals = {
            "NutPosition": nut_position_m,
            "ScrewSpeed": screw_speed_rpm,
            "AxisState": 2 if screw_speed_rpm else 1,
            "AliveCounter": self._alive,
        }
        self.mishaps.send(self._line(self._message, signals), period_s)

    def send_probed(self, growth_um: float) -> None:
        """Send the frame that follows a probing cycle, with the screw's growth in µm. Faults do not affect
        it.
        """
        self._write(self._line(self._probed, {"ScrewGrowth": growth_um}))

    def _line(self, message: Any, signals: Mapping[str, float]) -> bytes:
        data = message.encode(signals)
        stamp = f"{int(1e3 * time.monotonic()) % 60_000:04X}" if self._stamps else ""
        return f"t{message.frame_id:03X}{len(data)}{data.hex().upper()}{stamp}\r".encode()

    def _write(self, lines: bytes) -> None:
        with contextlib.suppress(OSError):
            os.read(self._master, 4096)  # commands to the adapter, which nobody answers
        with contextlib.suppress(OSError):  # nobody reads the wire, or it is closed
            if not _hung_up(self._master):
                os.write(self._master, lines)

    def close(self) -> None:
        """Leave the bus."""
        os.close(self._master)


class TruthPublisher:
    """A Zenoh publisher with its own session, opened when there is a router; only the newest message is sent.

    Everything that can block runs in a daemon thread. So the machine never waits for a router, nor for the
    end of a session with a router that no longer answers.

    Args:
        endpoint: The router's Zenoh endpoint, such as `tcp/127.0.0.1:7447`.
        key: The key of the messages.
    """

    def __init__(self, endpoint: str, key: str) -> None:
        self._endpoint = endpoint
        self._key = key
        self._next: str | None = None
        self._wake = threading.Event()
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._live, name="truth", daemon=True)
        self._thread.start()

    def publish(self, true: TrueHeats, sequence: int) -> None:
        """Publish these heats with the present time, as JSON of the form of the key `heat`. It returns at
        once.

        Args:
            true: The heats.
            sequence: The number of the message.
        """
        self._next = json.dumps(
            {
                "time_s": time.time(),
                "sequence": sequence,
                "sources": {
                    key.removesuffix("_W"): {"heat_W": heat_W, "sigma_W": 0.0}
                    for key, heat_W in asdict(true).items()
                },
                "quality": "good",
            }
        )
        self._wake.set()

    def close(self) -> None:
        """End the session, waiting 1 s for it at most."""
        self._stop.set()
        self._wake.set()
        self._thread.join(timeout=1.0)

    def _live(self) -> None:
        """Publish the newest document whenever there is one; runs in the publisher's thread until it is
        stopped.
        """
        config = zenoh.Config()
        config.insert_json5("mode", '"client"')
        config.insert_json5("connect/endpoints", json.dumps([self._endpoint]))
        config.insert_json5("scouting/multicast/enabled", "false")
        session = None
        while session is None and not self._stop.is_set():
            try:
                session = zenoh.open(config)
            except zenoh.ZError:
                self._stop.wait(RETRY_S)
        if session is None:
            return
        with session:
            publisher = session.declare_publisher(
                self._key,
                encoding=zenoh.Encoding.APPLICATION_JSON,
                congestion_control=zenoh.CongestionControl.DROP,
            )
            while not self._stop.is_set():
                self._wake.wait()
                self._wake.clear()
                if self._next is not None and not self._stop.is_set():
                    publisher.put(self._next)
