"""`python -m drivers.simulated`: prints the addresses of its wires in one JSON line, then runs in real time.

It ends on SIGTERM, SIGINT, or when its standard input is closed, so it never outlives the process that
started it.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import logging
import os
import signal
import sys
import threading

# python-can would load asammdf and pandas, pymodbus a web server: half of the time until the wires are there
sys.modules.update(dict.fromkeys(("asammdf", "aiohttp")))  # type: ignore[arg-type]  # None: not to be found

from pydantic import ValidationError  # noqa: E402

from drivers.simulated.faults import Faults, MachineCommand  # noqa: E402
from drivers.simulated.housings import HousedMachine  # noqa: E402
from drivers.simulated.machine import SimulatedMachine, speed_rpm  # noqa: E402
from drivers.simulated.wires import (  # noqa: E402
    AxisBus,
    ThermocoupleServer,
    TruthPublisher,
    icpdas_m7018,
    wago_750_458,
)

STEP_S = 0.02  # also the cycle of the CAN frame
WARM_STEP_S = 0.1
MAPS = {"wago_750_458": wago_750_458, "icpdas_m7018": icpdas_m7018}


def arguments() -> argparse.Namespace:
    """Return the parsed command line."""
    parser = argparse.ArgumentParser(prog="python -m drivers.simulated", description="A simulated machine.")
    parser.add_argument("--port", type=int, default=0, help="Modbus TCP port on loopback; 0 takes a free one")
    parser.add_argument("--map", choices=sorted(MAPS), default="wago_750_458", help="thermocouple module")
    parser.add_argument(
        "--housings", action="store_true", help="thermocouples on nut and housings, none on the screw"
    )
    parser.add_argument("--seed", type=int, default=1, help="of the thermocouples' noise")
    parser.add_argument("--period", type=float, default=0.1, help="s between new thermocouple values")
    parser.add_argument("--can-stamps", action="store_true", help="have the CAN adapter stamp its frames")
    parser.add_argument(
        "--scale", action="store_true", help="send how far the screw has grown at the nut with each frame"
    )
    parser.add_argument("--warm-minutes", type=float, default=20.0, help="how long it has been running")
    parser.add_argument("--zenoh", help="endpoint of a router to publish the truth to")
    parser.add_argument("--key", default="ballscrew/demo/x/truth/heat", help="key of the truth")
    return parser.parse_args()


class MachineProcess:
    """The machine and its wires.

    It prints one JSON line with `modbus_port`, `can_device` and `pid` once its wires are there. Then it obeys
    JSON lines on standard input, each as `faults.MachineCommand` describes.

    Args:
        args: The command line, as `arguments` returns it. The machine runs for `--warm-minutes` before it
            starts.
    """

    def __init__(self, args: argparse.Namespace) -> None:
        self._machine = HousedMachine(args.seed) if args.housings else SimulatedMachine(args.seed)
        self._args = args
        self._encode = MAPS[args.map]
        self._steps_per_period = max(1, round(args.period / STEP_S))
        self._faults = Faults()
        self._last = self._machine.thermocouples_degC()
        self._server = ThermocoupleServer(args.port, self._encode(self._last, self._faults))
        self._truth = TruthPublisher(args.zenoh, args.key) if args.zenoh else None
        self._sequence = 0
        self._commands: asyncio.Queue[bytes | None] = asyncio.Queue()
        for _ in range(round(60 * args.warm_minutes / WARM_STEP_S)):
            self._machine.advance(WARM_STEP_S)

    async def run(self) -> None:
        """Run until SIGTERM, SIGINT or the end of standard input.

        At its end the wires are closed. A defect while it runs is raised here.
        """
        loop = asyncio.get_running_loop()
        for number in (signal.SIGTERM, signal.SIGINT):
            loop.add_signal_handler(number, self._commands.put_nowait, None)
        threading.Thread(target=self._read_stdin, args=(loop,), daemon=True).start()
        self._sample()
        await self._server.start()
        axis = AxisBus(self._args.can_stamps, self._args.seed)
        places = {"modbus_port": self._server.port, "can_device": axis.device, "pid": os.getpid()}
        print(json.dumps(places), flush=True)
        work = loop.create_task(self._work(axis))
        listen = loop.create_task(self._listen(axis))
        await asyncio.wait({work, listen}, return_when=asyncio.FIRST_COMPLETED)
        failed = work.done()
        for task in (work, listen):
            task.cancel()
        await asyncio.gather(work, listen, return_exceptions=not failed)
        if self._truth:
            self._truth.close()
        axis.close()
        await self._server.stop()

    async def _work(self, axis: AxisBus) -> None:
        """Advance the machine in real time and keep its wires fed.

        After a delay by a busy computer the machine is where it would have been; missed frames
        are not sent late, and the next keeps half a cycle's distance.
        """
        loop = asyncio.get_running_loop()
        start_s = loop.time()
        step = 0
        while True:
            cycles = round((loop.time() - start_s) / STEP_S) + 1
            await asyncio.sleep(start_s + cycles * STEP_S - loop.time())
            before, step = step, int((loop.time() - start_s) / STEP_S + 1e-3)  # it may wake a little early
            for _ in range(step - before):
                self._machine.advance(STEP_S)
            if not self._faults.silence_can:
                position_m = self._machine.nut_position_m(loop.time() - start_s - step * STEP_S)
                axis.send(position_m + self._faults.homed_off_m, speed_rpm(self._machine.time_s), STEP_S)
                if self._args.scale:
                    axis.send_probed(self._machine.probed_um(position_m))
            if before // self._steps_per_period != step // self._steps_per_period:
                self._sample()
                if self._truth:
                    self._sequence += 1
                    self._truth.publish(self._machine.heats(), self._sequence)

    def _sample(self) -> None:
        """Read the thermocouples into the registers."""
        self._last = self._faults.read_degC(self._machine.thermocouples_degC(), self._last)
        self._server.registers = self._encode(self._last, self._faults)

    async def _listen(self, axis: AxisBus) -> None:
        """Obey commands until the input ends."""
        while (line := await self._commands.get()) is not None:
            if not line.strip():
                continue
            try:
                command = MachineCommand.model_validate_json(line)
            except ValidationError as error:
                print(f"command refused: {error}", file=sys.stderr, flush=True)
                continue
            if command.probe_m is not None:
                axis.send_probed(growth_um := self._machine.probed_um(command.probe_m))
                print(json.dumps({"probed_um": growth_um}), flush=True)
                continue
            self._faults = command.fault or Faults()
            axis.mishaps.set(self._faults)
            self._server.exception = self._faults.exception
            await self._server.set_listening(not self._faults.drop_modbus)
            self._sample()
            print(json.dumps({"faults": self._faults.model_dump(exclude_defaults=True)}), flush=True)

    def _read_stdin(self, loop: asyncio.AbstractEventLoop) -> None:
        """Hand lines to the event loop.

        It reads the bare descriptor, because a read of `sys.stdin` would delay the exit.
        """
        partial = b""
        while True:
            data = os.read(0, 4096)
            *lines, partial = (partial + data).split(b"\n")
            for line in [*lines, None] if not data else lines:
                try:
                    loop.call_soon_threadsafe(self._commands.put_nowait, line)
                except RuntimeError:  # the loop has ended
                    return
            if not data:
                return


def main() -> None:
    """Start the machine and return when it has ended."""
    logging.basicConfig(level=logging.CRITICAL)
    asyncio.run(MachineProcess(arguments()).run())


if __name__ == "__main__":
    main()
