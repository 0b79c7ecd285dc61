"""`make faults`: the real daemon on simulated wires, under faults; prints the table of faults.

What other trusted daemons promise, and the figure to beat. Ends with 1 where one is not met. Three
minutes; needs chromium and mosquitto of Debian's packages.
"""

from __future__ import annotations

import asyncio
import os
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterable
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from campaigns.faults import outlets
from campaigns.faults.judge import Fault, believed_for_s, is_used, unflagged
from campaigns.faults.table import Row, as_markdown
from tests.bus.router import Router, free_port
from tests.drivers.slave import Slave
from tests.drivers.test_modbus_wires import read_rtu, values, wrong
from tests.patience import PATIENCE_S, Stopwatch, until
from tests.system.plant import PERIOD_S, ROOT, Daemon, Machine, Subscriber, machine, table_for

SENSORS = frozenset({"t1", "t2", "t3", "t4", "t5"})
LASTS_S = 2.0
STALE_S = 2 * PERIOD_S
BACK_S = 1.0
EXIT_S = 2.0
PAUSE_S = 8.0
SETTLE = 200
"""Estimates after the last fault before the restart: it is promised for heats that have settled."""
OUTAGE_S = 3.3  # by then Zenoh's own pauses between attempts have grown to four seconds
SURFACES = ("estimate", "heat", "field", "error", "health")


@dataclass
class Plant:
    """Machine, daemon and subscriber, and what was seen so far."""

    machine: Machine
    daemon: Daemon
    seen: Subscriber
    faults: list[Fault] = field(default_factory=list)
    late_s: list[float] = field(default_factory=list)
    back_s: list[float] = field(default_factory=list)
    words: dict[str, dict[str, str]] = field(default_factory=dict)
    unflagged: int = 0
    in_time: bool = True
    estimates: int = 0

    def watch(self) -> Stopwatch:
        """Leaves out what the computer held these processes up."""
        return Stopwatch(self.machine.pid, self.daemon.process.pid)

    def under(self, name: str, sensors: frozenset[str], begin: Callable[[], float]) -> None:
        """Put a fault in force for a while, note how the estimates took it, and clear it."""
        self.seen.wait_until_good()
        watch = self.watch()
        begin_s = begin()
        self.seen.wait_until_after(begin_s + STALE_S)
        held_s = watch.held_up_s()
        fault = Fault(name, sensors, begin_s, begin_s + STALE_S + held_s + LASTS_S, STALE_S + held_s)
        self.seen.wait_until_after(fault.end_s)
        self.note(name)
        self.faults.append(fault)
        self.unflagged += unflagged(self.seen.estimates, fault)
        self.estimates += len(self.seen.between(begin_s + fault.allowed_s, fault.end_s))
        self.late_s.append(believed_for_s(self.seen.estimates, fault))
        self.in_time &= self.late_s[-1] <= STALE_S + held_s
        watch = self.watch()
        os.kill(self.machine.pid, signal.SIGCONT)
        cleared_s = self.machine.fault()
        touched = sensors or SENSORS

        def back() -> float | None:
            after = self.seen.between(cleared_s, float("inf"))
            return next((e["time_s"] for e in after if is_used(e, touched)), None)

        self.back_s.append(max(0.0, until(back) - cleared_s - watch.held_up_s()))
        good_s = self.seen.wait_until_good() - cleared_s
        _say(
            f"  {name}: believed for {self.late_s[-1]:.2f} s more, read again after {self.back_s[-1]:.2f} s, "
            f"good after {good_s:.2f} s"
        )

    def note(self, name: str) -> None:
        """What each surface says now."""
        self.words[name] = self.qualities()

    def qualities(self) -> dict[str, str]:
        """What each surface says."""
        found = {key: self.seen.documents[key][-1]["quality"] for key in ("heat", "field", "error")}
        return found | {"estimate": self.seen.estimates[-1]["quality"], "health": self.seen.health()["state"]}


def main() -> int:
    """Measure all rows and print them."""
    with tempfile.TemporaryDirectory() as folder, ExitStack() as stack:
        pings = stack.enter_context(Pings(Path(folder) / "notify"))
        os.environ["NOTIFY_SOCKET"] = str(pings.path)
        words, rows = _live(Path(folder), pings)
        del os.environ["NOTIFY_SOCKET"]
        _say("page, MQTT and OPC UA")
        more, others = outlets.measured(Path(folder) / "outlets")
    rows.insert(4, Row("ROS diagnostics", "STALE is its own level", *_surfaces(words | more)))
    rows += others
    rows.insert(2, _registers())
    print(as_markdown(rows))
    return 0 if all(row.met for row in rows) else 1


class Pings:
    """Stands in for systemd: counts what the daemon sends it."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def __enter__(self) -> Pings:
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self._socket.bind(str(self.path))
        self.count = 0
        self._reader = threading.Thread(target=self._read, daemon=True)  # its queue holds ten
        self._reader.start()
        return self

    def _read(self) -> None:
        while (said := self._socket.recv(4096)) != b"end":
            self.count += b"WATCHDOG=1" in said

    def __exit__(self, *_: object) -> None:
        with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as end:
            end.sendto(b"end", str(self.path))
        self._reader.join(PATIENCE_S)
        self._socket.close()


def _live(folder: Path, pings: Pings) -> tuple[dict[str, tuple[str, ...]], list[Row]]:
    port = free_port()
    endpoint = f"tcp/127.0.0.1:{port}"
    with machine() as made, ExitStack() as stack:
        table = table_for(made.wires, mode="client", connect=[endpoint])
        daemon = stack.enter_context(Daemon(folder, table))
        with Router(port), Subscriber(endpoint) as seen:
            plant = Plant(made, daemon, seen)
            seen.wait_until_good()
            until(lambda: seen.health() and len(seen.documents.get("error", ())) > 2)
            _say("faults of devices and wires")
            _faults(plant)
            counted = _drops(plant)
            before, last = seen.health(), seen.estimates[-1]["sequence"]
        _say("a router that is killed and comes back")
        killed_s = time.time()
        until(lambda: max(daemon.step_times_s(), default=0.0) > killed_s + OUTAGE_S)
        with Router(port) as router, Subscriber(endpoint) as seen:
            router_s, missed, lost = _router_back(plant, router, seen, last, before)
            _say("a warm restart, and an end with the router frozen")
            seen.wait_for_more(SETTLE)
            before_W = _good(seen)
            daemon.stop()
            cycles = len(daemon.step_times_s())
            pinged = until(lambda: pings.count)
            stopped_s = time.monotonic()
            until(lambda: time.monotonic() - stopped_s > PAUSE_S)
            daemon = stack.enter_context(Daemon(folder, table))
            moved = _moved(before_W, _good(seen))
            exit_s = _frozen(daemon, router)
    watchdog = _watchdog(pinged, cycles, _hung_pings(folder / "hung"))
    reconnected_s = max(*plant.back_s, router_s)
    words = {s: tuple(plant.words[name][s] for name in ("good", "open", "hangs")) for s in SURFACES}
    return words, [
        Row(
            "EPICS",
            "severity and reason on every value",
            "0 unflagged values under injected faults",
            f"{plant.unflagged} of {plant.estimates} estimates under {len(plant.faults)} faults",
            plant.unflagged == 0,
        ),
        Row(
            "NUT",
            "stale after 15 s",
            "stale within 2 sample periods",
            f"believed for at most {max(plant.late_s) / PERIOD_S:.1f} periods of {PERIOD_S:g} s",
            plant.in_time,
        ),
        Row(
            "OpenTelemetry Collector",
            "gives up at 300 s, drops counted",
            "reconnects in ≤ 1 s of the peer's return, every drop counted",
            f"read again {max(plant.back_s):.1f} s after a device at most, {router_s:.1f} s after a router; "
            f"{counted} of 3 reconnects counted, {missed} messages where {lost} estimates were missed",
            reconnected_s <= BACK_S and counted == 3 and missed >= lost,
        ),
        Row(
            "systemd",
            "ping at half the interval",
            "watchdog ping only from a completed estimator cycle",
            *watchdog,
        ),
        Row(
            "–",
            "warm restart",
            "heats step by < 1 σ",
            f"{moved:.2f} σ over a pause of {PAUSE_S:g} s",
            moved < 1.0,
        ),
        Row(
            "–",
            "exits with the router frozen",
            "≤ 2 s",
            f"{max(0.0, exit_s):.1f} s",
            exit_s <= EXIT_S,
        ),
    ]


def _say(what: str) -> None:
    print(f"{what} …", file=sys.stderr, flush=True)


def _faults(plant: Plant) -> None:
    """One after the other, each cleared before the next."""
    inject = plant.machine.fault
    plant.seen.wait_until_good()
    until(lambda: set(plant.qualities().values()) == {"good"})
    plant.note("good")
    plant.under("open", frozenset({"t3"}), lambda: inject(open="t3_degC"))
    plant.under("over_range", frozenset({"t4"}), lambda: inject(over_range="t4_degC"))
    plant.under("exception", SENSORS, lambda: inject(exception=4))
    plant.under("dropped", SENSORS, lambda: inject(drop_modbus=True))
    plant.under("silent", frozenset(), lambda: inject(silence_can=True))
    both = frozenset({"t1", "t5"})
    plant.under("several", both, lambda: inject(open=["t1_degC", "t5_degC"], silence_can=True))
    plant.under("hangs", SENSORS, lambda: _hang(plant.machine))


def _hang(plant: Machine) -> float:
    """Its server accepts and does not answer, its bus is silent."""
    os.kill(plant.pid, signal.SIGSTOP)
    return time.time()


def _drops(plant: Plant) -> int:
    """Cut the line three times; returns how many of them were counted."""

    def reconnects() -> int:
        return int(plant.seen.health()["drivers"]["thermocouples"]["reconnects"])

    until(lambda: plant.seen.health()["state"] == "good")
    before = reconnects()
    for number in range(3):
        plant.under(f"dropped {number}", SENSORS, lambda: plant.machine.fault(drop_modbus=True))
    until(lambda: reconnects() >= before + 3)
    return reconnects() - before


def _router_back(
    plant: Plant, router: Router, seen: Subscriber, last: int, before: dict[str, Any]
) -> tuple[float, int, int]:
    """A router has come back after an outage: when estimates came, messages counted, estimates missed."""
    watch, listening_s = Stopwatch(router.pid, plant.daemon.process.pid, plant.machine.pid), time.time()
    back_s = seen.wait_until_good() - listening_s - watch.held_up_s()
    until(lambda: seen.health().get("publish_reconnects", 0) > before["publish_reconnects"])
    counted = seen.health()["publish_drops"] - before["publish_drops"]
    return max(0.0, back_s), counted, seen.estimates[0]["sequence"] - last - 1


def _moved(before: dict[str, Any], after: dict[str, Any]) -> float:
    """How far the heats have moved, in σ."""
    sigma_W = np.maximum(before["heat_sigma_W"], after["heat_sigma_W"])
    return float(np.max(np.abs(after["heat_W"] - before["heat_W"]) / sigma_W))


def _good(seen: Subscriber) -> dict[str, Any]:
    time_s = seen.wait_until_good()
    return next(e for e in seen.estimates if e["time_s"] == time_s)


def _frozen(daemon: Daemon, router: Router) -> float:
    """How long an end takes while the router is frozen."""
    router.freeze()
    frozen_s = time.monotonic()
    until(lambda: time.monotonic() > frozen_s + 1.0)  # some messages into the void
    try:
        return daemon.stop()
    finally:
        router.thaw()


def _hung_pings(folder: Path) -> tuple[int, int]:
    """Pings of a service whose step hangs, before and in two seconds of hanging."""
    command = [
        sys.executable,
        "-m",
        "tests.service.process",
        f"tcp/127.0.0.1:{free_port()}",
        str(folder),
        "step",
    ]
    with subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, text=True) as process:
        output: Iterable[str] = process.stdout or ()
        said: list[str] = []
        reader = threading.Thread(target=lambda: said.extend(line.strip() for line in output))
        reader.start()
        until(lambda: "hanging" in said)
        begin_s = time.monotonic()
        until(lambda: time.monotonic() - begin_s > 2.0)
        process.kill()
        reader.join(PATIENCE_S)
    at = said.index("hanging")
    return said[:at].count("ping"), said[at:].count("ping")


def _watchdog(pings: int, cycles: int, hung: tuple[int, int]) -> tuple[str, bool]:
    words = f"{pings} pings of {cycles} cycles; {hung[1]} in 2 s of a step that hangs"
    return words, 0 < pings <= cycles and hung[1] == 0


def _surfaces(three: dict[str, tuple[str, ...]]) -> tuple[str, str, bool]:
    """The figure, and what each surface says where all is well, one sensor is at fault, and none is heard."""
    right = {surface for surface, words in three.items() if words == outlets.STATES}
    odd = "".join(f"; {s}: {', '.join(words)}" for s, words in three.items() if s not in right)
    measured = f"good, degraded, stale on {len(right)} of {len(three)}{odd}"
    return "stale ≠ error ≠ good on every surface", measured, len(right) == len(three)


def _registers() -> Row:
    """Replies that come late over a serial line: each register holds its own address."""
    _say("late replies on a serial line")

    async def measure() -> tuple[int, int]:
        slaves = [Slave(every=3, late_s=late_s) for late_s in (0.12, 0.16, 0.26, 0.5)]
        read = await asyncio.gather(*map(read_rtu, slaves))
        return sum(len(wrong(one)) for one in read), sum(len(values(one)) for one in read)

    mistaken, total = asyncio.run(measure())
    return Row(
        "Telegraf",
        "1 s timeout",
        "0 values from a wrong register",
        f"{mistaken} of {total} values",
        mistaken == 0,
    )


if __name__ == "__main__":
    sys.exit(main())
