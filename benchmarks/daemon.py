"""The daemon as a process: processor, memory also with its outlets, and the time to its first estimate."""

from __future__ import annotations

import asyncio
import os
import signal
import statistics
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from queue import Queue

import numpy as np
import zenoh

from benchmarks.table import Result
from drivers.simulated.wires import ThermocoupleServer
from observer.bus.session import session_config
from tests.bus.router import free_port
from tests.logs.machines import SCREW

SENSORS, MODES, POINTS, PERIOD_S = 12, 40, 200, 0.1
ROOT, HOUSED = Path(__file__).parents[1], "demo-housings.toml"
_SENSORS_OF_HOUSINGS = ("nut_body_degC", "left_housing_degC", "right_housing_degC")
RAW_PER_K, RAW_PER_M = 100, 10_000
STARTS = 5
FILL_S = 110.0
"""Until it keeps as many estimates as it ever will, 1000 for those who ask for the last ones."""
SETTLED_S = 30.0
"""For so long the outlets may take until they serve all that is asked for."""
HOUR_S = 3600.0
START_S = 60.0
"""For so long a daemon may take until its first estimate."""


def results(seconds: float = 30.0) -> list[Result]:
    """Run `observer run` on a Modbus server; growth is judged only over an hour (`--daemon-seconds 3600`)."""
    with tempfile.TemporaryDirectory() as directory, _module() as port:
        place = _Place(Path(directory), port)
        help_s = statistics.median(_help_s(place) for _ in range(STARTS))
        try:
            start_s = statistics.median(_start_once(place) for _ in range(STARTS))
            load, resident_MB, growth_MB = _load(place, seconds)
            together_MB = _together_MB(place)
            housed = _load(_Place(place.folder, port, housed=True), seconds)[0]
        except RuntimeError as error:
            return [Result("daemon and start", f"not measured: {error}")]
    size = f"{SENSORS} sensors, {MODES} modes, {POINTS} points"
    growth = Result(
        f"  growth over {seconds:g} s",
        f"{growth_MB:.1f} MB",
        goal="none in an hour",
        met=growth_MB < 2.0 if seconds >= HOUR_S else None,
    )
    return [
        _at_most("observer --help", help_s, 0.4, "s", 2),
        _at_most("start to first estimate at a subscriber", start_s, 1.0, "s", 2),
        Result(f"daemon at 10 Hz, {size}", f"{load:.1%} of a core", goal="≤ 5 %", met=load <= 0.05),
        Result(f"  {HOUSED}, its 3 sensors", f"{housed:.1%} of a core", goal="≤ 8 %", met=housed <= 0.08),
        _at_most("  resident", resident_MB, 200, "MB"),
        growth,
        _at_most("  resident, with the process of page, Prometheus and OPC UA", together_MB, 200, "MB"),
    ]


def _at_most(work: str, value: float, bound: float, unit: str, digits: int = 0) -> Result:
    return Result(work, f"{value:.{digits}f} {unit}", goal=f"≤ {bound:g} {unit}", met=value <= bound)


@dataclass(frozen=True, slots=True)
class _Place:
    """Where daemons run one after the other, on one Modbus server; of a screw with housings or without."""

    folder: Path
    port: int
    housed: bool = False

    @property
    def environment(self) -> dict[str, str]:
        """Bytecode as any installation has it."""
        kept = {key: value for key, value in os.environ.items() if key != "PYTHONDONTWRITEBYTECODE"}
        return kept | {"PYTHONPYCACHEPREFIX": str(self.folder)}


def _help_s(place: _Place) -> float:
    began_s = time.monotonic()
    command = [sys.executable, "-m", "observer", "--help"]
    subprocess.run(command, env=place.environment, stdout=subprocess.DEVNULL, check=True)
    return time.monotonic() - began_s


def _start_once(place: _Place) -> float:
    with _daemon(place) as (_, first_s):
        return first_s


def _load(place: _Place, seconds: float) -> tuple[float, float, float]:
    """Share of a core, resident MB at the end, and growth in MB, once the start is over."""
    with _daemon(place) as (pid, _):
        time.sleep(min(FILL_S, seconds))
        busy_s, resident_MB, began_s = _cpu_s(pid), _resident_MB(pid), time.monotonic()
        time.sleep(seconds)
        share = (_cpu_s(pid) - busy_s) / (time.monotonic() - began_s)
        return share, _resident_MB(pid), _resident_MB(pid) - resident_MB


def _together_MB(place: _Place) -> float:
    """Resident MB of daemon and outlets, the pages that they share counted once."""
    page, metrics, opcua = (f"127.0.0.1:{free_port()}" for _ in range(3))
    outlets = (
        f'[page]\nlisten = "{page}"\n[metrics]\nlisten = "{metrics}"\n[opcua]\nlisten = "opc.tcp://{opcua}"\n'
    )
    with _daemon(place, outlets) as (pid, _):
        time.sleep(SETTLED_S)
        children = [
            int(child)
            for thread in Path(f"/proc/{pid}/task").iterdir()
            for child in (thread / "children").read_text().split()
        ]
        found = [_private_and_shared_MB(process) for process in (pid, *children)]
        return sum(private for private, _ in found) + max(shared for _, shared in found)


@contextmanager
def _daemon(place: _Place, outlets: str = "") -> Iterator[tuple[int, float]]:
    """A daemon that has published its first heat, and how long that took."""
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    config = place.folder / "config.toml"
    machine = _housed_text() if place.housed else _screw_text()
    sensors = _SENSORS_OF_HOUSINGS if place.housed else [f"t{i}_degC" for i in range(1, SENSORS + 1)]
    config.write_text(machine + _wires_text(sensors, place.port, endpoint) + outlets)
    with zenoh.open(session_config("router", (), (endpoint,))) as session:
        heat = session.declare_subscriber("ballscrew/**/heat", zenoh.handlers.RingChannel(1))
        command = [sys.executable, "-m", "observer", "run", "--config", str(config)]
        began_s = time.monotonic()
        process = subprocess.Popen(
            command, env=place.environment, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True
        )
        try:
            while heat.try_recv() is None:
                if process.poll() is not None or time.monotonic() - began_s > START_S:
                    raise RuntimeError(_last_line(process))
                time.sleep(0.005)
            yield process.pid, time.monotonic() - began_s
        finally:
            process.send_signal(signal.SIGTERM)
            process.wait(timeout=10)


def _last_line(process: subprocess.Popen[str]) -> str:
    if process.poll() is None or process.stderr is None:
        return f"no heat within {START_S:g} s"
    return (process.stderr.read().strip().splitlines() or ["it ended without a word"])[-1]


def _cpu_s(pid: int) -> float:
    """User and system time of a process (fields 14 and 15 of its stat line)."""
    fields = Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def _resident_MB(pid: int) -> float:
    pages = int(Path(f"/proc/{pid}/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6


def _private_and_shared_MB(pid: int) -> tuple[float, float]:
    """Resident memory that a process has by itself, and that others have too."""
    lines = (line.split() for line in Path(f"/proc/{pid}/smaps_rollup").read_text().splitlines()[1:])
    kB = {name: int(size) for name, size, *_ in lines}
    private, shared = (
        1.024e-3 * (kB[f"{whose}_Clean:"] + kB[f"{whose}_Dirty:"]) for whose in ("Private", "Shared")
    )
    return private, shared


@contextmanager
def _module() -> Iterator[int]:
    """A Modbus TCP server, in a thread of this process, with noisy thermocouples, nut position and speed."""
    ports: Queue[int] = Queue()
    stopped = threading.Event()
    thread = threading.Thread(target=lambda: asyncio.run(_serve(ports, stopped)), daemon=True)
    thread.start()
    try:
        yield ports.get(timeout=10.0)
    finally:
        stopped.set()
        thread.join()


async def _serve(ports: Queue[int], stopped: threading.Event) -> None:
    server = ThermocoupleServer(0, _registers(0.0))
    await server.start()
    ports.put(server.port)
    began_s = time.monotonic()
    while not stopped.is_set():
        server.registers = _registers(time.monotonic() - began_s)
        await asyncio.sleep(PERIOD_S / 2.0)
    await server.stop()


def _registers(time_s: float) -> list[int]:
    noise_K = 0.05 * np.random.default_rng().standard_normal(SENSORS)
    position_m = 0.5 + 0.2 * np.sin(0.3 * time_s)
    return [*np.round(RAW_PER_K * (20.0 + noise_K)).astype(int).tolist(), round(RAW_PER_M * position_m), 1500]


def _housed_text() -> str:
    """The machine of the demo with housings, at this benchmark's period."""
    machine = (ROOT / "config" / HOUSED).read_text(encoding="utf-8").partition("[drivers.")[0]
    return machine.replace("period_s = 0.5", f"period_s = {PERIOD_S}")


def _screw_text() -> str:
    screw = "\n".join(f"{key} = {value}" for key, value in SCREW.items())
    sensors = "\n".join(
        f'[[sensor]]\nname = "t{i}"\nchannel = "t{i}_degC"\nposition_m = {x:.4f}\nnoise_K = 0.05'
        for i, x in enumerate(np.linspace(0.05, 0.95, SENSORS), 1)
    )
    ends = "\n".join(
        f'[[source]]\nname = "{name}"\nshape = "point"\nposition_m = {x}\nspeed_channel = "screw_speed_rpm"\n'
        "heat_W_rpm = 0.006"
        for name, x in (("left", 0.0), ("right", 1.0))
    )
    return f"""
[machine]
name = "benchmark"
[screw]
{screw}
expansion_1_K = 11.8e-6
[surface]
convection_W_m2K = 15.0
[ambient]
temperature_degC = 20.0
[[source]]
name = "nut"
shape = "nut"
length_m = 0.08
stroke_m = [0.2, 0.8]
position_channel = "nut_position_m"
speed_channel = "screw_speed_rpm"
torque_Nm = 0.3
share = 0.5
{ends}
{sensors}
[model]
modes = {MODES}
[estimator]
period_s = {PERIOD_S}
[output]
positions_m = {np.linspace(0.0, 1.0, POINTS).tolist()}
"""


def _wires_text(sensors: Sequence[str], port: int, endpoint: str) -> str:
    scales = dict.fromkeys(sensors, 1 / RAW_PER_K)
    registers = [*range(len(sensors)), SENSORS, SENSORS + 1]
    scales |= {"nut_position_m": 1 / RAW_PER_M, "screw_speed_rpm": 1.0}
    channels = "\n".join(
        f"{name} = {{ register = {register}, scale = {scale} }}"
        for register, (name, scale) in zip(registers, scales.items(), strict=True)
    )
    return f"""
[drivers.module]
kind = "modbus_tcp"
host = "127.0.0.1"
port = {port}
period_s = {PERIOD_S}
[drivers.module.channels]
{channels}
[publish]
mode = "client"
connect = ["{endpoint}"]
"""
