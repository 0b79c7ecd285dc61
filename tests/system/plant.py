"""A simulated machine, the real daemon and a plain subscriber, each in a process or session of its own."""

from __future__ import annotations

import csv
import itertools
import json
import math
import os
import signal
import subprocess
import sys
import time
import tomllib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import tomlkit
import zenoh

from observer.bus.codec import decode_estimate
from observer.bus.session import session_config
from tests.bus.router import free_port
from tests.patience import PATIENCE_S, Stopwatch, until

ROOT = Path(__file__).parents[2]
DEMO = ROOT / "config" / "demo.toml"
PREFIX = "ballscrew/demo/x"
AXIS = ("--machine", "demo", "--axis", "x")
PERIOD_S = 0.1  # of estimator and thermocouples in these tests
CAN_TIMEOUT_S = 0.3
HELD_UP_S = 1.0
"""For so long a busy computer may keep a program from running (more than 0.5 s was seen, with three programs
to a core); waiting for a peer that is gone takes seconds, again and again.
"""
# A heat that may be anything at the start is known, and the estimate good, within seconds; from the demo's
# 8 W it takes half a minute until the sensors are better than that.
UNKNOWN_W = 100.0
# Such heats leave the bound of the error wide for minutes, beyond the default limit_um of a compensation.
COMPENSATION = {
    "enabled": True, "controller_compensates": False, "position_feedback": "motor", "limit_um": 1000.0,
    "hold_s": 0.5,
}  # fmt: skip
START_S = 2 * PATIENCE_S  # libraries are loaded, and being good has to be earned


class Machine:
    """The simulated machine's process; `wires` says where its devices are."""

    def __init__(self, process: subprocess.Popen[bytes]) -> None:
        self._process = process
        self.pid = process.pid
        self.wires: dict[str, Any] = json.loads(process.stdout.readline())

    def fault(self, **faults: Any) -> float:
        """Put exactly these faults in force; returns when they were, in seconds since the epoch."""
        assert "faults" in self._obeyed({"fault": faults})
        return time.time()

    def probe(self, position_m: float) -> float:
        """Have it probe once how far the screw has grown at a place; returns what its frame says, in µm."""
        return float(self._obeyed({"probe_m": position_m})["probed_um"])

    def _obeyed(self, command: dict[str, Any]) -> dict[str, Any]:
        self._process.stdin.write(json.dumps(command).encode() + b"\n")
        self._process.stdin.flush()
        answer: dict[str, Any] = json.loads(self._process.stdout.readline())
        return answer


@contextmanager
def machine(warm_minutes: float = 1.0, *options: str) -> Iterator[Machine]:
    """A running machine that has been warm for so long; it ends when its standard input closes."""
    process = subprocess.Popen(
        [
            sys.executable,
            "-m",
            "drivers.simulated",
            "--warm-minutes",
            str(warm_minutes),
            "--period",
            "0.05",
            *options,
        ],
        cwd=ROOT,
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
    )
    try:
        yield Machine(process)
    finally:
        process.send_signal(signal.SIGCONT)
        process.stdin.close()
        try:
            assert process.wait(PATIENCE_S) == 0
        finally:
            process.kill()
            process.stdout.close()


def table_for(wires: dict[str, Any], **publish: Any) -> dict[str, Any]:
    """The demo's configuration as a table, on these wires, at the tests' period, and soon good."""
    table = tomllib.loads(DEMO.read_text(encoding="utf-8"))
    table["estimator"]["period_s"] = PERIOD_S
    for source in table["source"]:
        source["initial_sigma_W"] = UNKNOWN_W
    table["drivers"]["thermocouples"] |= {
        "port": wires["modbus_port"],
        "period_s": PERIOD_S,
        "timeout_s": 0.3,
    }
    table["drivers"]["axis"] |= {"channel": wires["can_device"], "timeout_s": CAN_TIMEOUT_S}
    table["drivers"]["axis"]["dbc"] = str(ROOT / "drivers" / "simulated" / "axis.dbc")
    table["publish"] = publish
    return table


def write(folder: Path, table: dict[str, Any], name: str = "config.toml") -> Path:
    """A configuration as a file."""
    path = folder / name
    path.write_text(tomlkit.dumps(table), encoding="utf-8")
    return path


def run_observer(*words: str) -> subprocess.CompletedProcess[str]:
    """Run a command of `observer` to its end."""
    command = [sys.executable, "-m", "observer", *words]
    return subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=500, check=False)


def ask(verb: str, endpoint: str, *more: str) -> subprocess.CompletedProcess[str]:
    """Give the service at an endpoint a command."""
    return run_observer(verb, *more, *AXIS, "--connect", endpoint, "--timeout-s", "30")


class Daemon:
    """`observer run` as a process; what it says on standard error is kept in a file."""

    def __init__(
        self,
        folder: Path,
        table: dict[str, Any],
        launcher: tuple[str, ...] = ("-m", "observer"),
        **record: Any,
    ) -> None:
        self.recordings = folder / "recordings"
        self.config = write(folder, table | {"record": {"directory": str(self.recordings), **record}})
        self._stderr = folder / "stderr"
        command = [sys.executable, *launcher, "run", "--config", str(self.config), "--log-format", "json"]
        with self._stderr.open("wb") as stderr:
            self.process = subprocess.Popen(command, cwd=ROOT, stderr=stderr)

    def __enter__(self) -> Daemon:
        return self

    def __exit__(self, *_: object) -> None:
        self.process.kill()
        self.process.wait(PATIENCE_S)

    def said(self) -> str:
        """Everything on standard error so far."""
        return self._stderr.read_text(encoding="utf-8")

    def ticks_s(self) -> list[float]:
        """The times of all ticks that are recorded so far, in order."""
        found = []
        for path in self.recordings.glob("*.csv"):
            rows = csv.DictReader(path.read_text().rpartition("\n")[0].splitlines())
            found += [float(row["time_s"]) for row in rows if row["step"] == "1"]
        return sorted(found)

    def stop(self) -> float:
        """Terminate; returns how long that took. Raises where the exit is not clean."""
        watch = Stopwatch(self.process.pid)
        self.process.send_signal(signal.SIGTERM)
        took_s = watch.until(lambda: self.process.poll() is not None)
        assert self.process.returncode == 0, self.said()
        assert "Traceback" not in self.said()
        return took_s

    def recording(self) -> Path:
        """The one file of the recording."""
        (path,) = self.recordings.glob("*.csv")
        return path

    def step_times_s(self) -> list[float]:
        """The ticks in the recording so far."""
        return [float(row[0]) for row in self._rows()[1:] if row[-3] == "1"]

    def readings(self, channel: str, tick_s: float) -> list[str]:
        """The values of a channel that the recording has up to the tick of that time; waits for that tick."""
        until(lambda: self.step_times_s()[-1] >= tick_s)
        head, *rows = self._rows()
        column = head.index(channel)
        used = itertools.takewhile(lambda row: row[-3] != "1" or float(row[0]) <= tick_s, rows)
        return [row[column] for row in used if row[column]]

    def _rows(self) -> list[list[str]]:
        """The recording so far; a row that is being written is left out."""
        return [row.split(",") for row in self.recording().read_text(encoding="utf-8").split("\n")[:-1]]

    def overruns(self) -> int:
        """How many ticks it says to have left out; to be asked once it has stopped."""
        (last,) = [json.loads(line) for line in self.said().splitlines() if '"event": "stopped"' in line]
        return int(last["overruns"])

    def assert_no_tick_is_missing(self) -> None:
        """Every multiple of the period from the first tick to the last is in the recording, once.

        A computer that is busy with something else may hold up any program for a moment. The daemon must then
        say how many ticks it has left out; but a loop that waits for a peer would miss many in a row.
        """
        # a tick that is held up is as late as what it takes in: beyond its multiple, never before it
        numbers = [math.floor(t / PERIOD_S + 1e-5) for t in self.step_times_s()]
        pauses = [after - before - 1 for before, after in itertools.pairwise(numbers)]
        assert min(pauses) >= 0
        assert max(pauses) * PERIOD_S <= HELD_UP_S
        assert sum(pauses) <= min(self.overruns(), 0.1 * len(numbers) + 1)


class Subscriber:
    """Keeps every message of the axis in the order of arrival."""

    def __init__(self, endpoint: str, attempts_s: float = START_S) -> None:
        self.endpoint = endpoint
        self._attempts_s = attempts_s
        self.estimates: list[dict[str, Any]] = []
        self.documents: dict[str, list[dict[str, Any]]] = {}

    def __enter__(self) -> Subscriber:
        self._session = until(self._attempt, self._attempts_s)
        self._subscriber = self._session.declare_subscriber(f"{PREFIX}/**", self._take)
        return self

    def __exit__(self, *_: object) -> None:
        self._subscriber.undeclare()
        self._session.close()

    def _attempt(self) -> zenoh.Session | None:
        try:
            return zenoh.open(session_config("client", (self.endpoint,), ()))
        except zenoh.ZError:
            return None  # nobody listens yet

    def _take(self, sample: zenoh.Sample) -> None:
        key = str(sample.key_expr).removeprefix(f"{PREFIX}/")
        data = sample.payload.to_bytes()
        if key == "estimate":
            self.estimates.append(decode_estimate(data))
        else:
            self.documents.setdefault(key, []).append(json.loads(data))

    def health(self) -> dict[str, Any]:
        """The newest health report, empty before the first."""
        return (self.documents.get("health") or [{}])[-1]

    def wait_until_good(self, timeout_s: float = START_S) -> float:
        """Wait for the next estimate that is good; returns its time."""
        start = len(self.estimates)

        def good() -> float | None:
            return next((e["time_s"] for e in self.estimates[start:] if e["quality"] == "good"), None)

        try:
            return float(until(good, timeout_s))
        except AssertionError as error:
            error.add_note(f"what it says of itself: {json.dumps(self.health())}")
            raise

    def wait_for_more(self, count: int) -> None:
        """Wait for so many more estimates."""
        seen = len(self.estimates)
        until(lambda: len(self.estimates) >= seen + count)

    def wait_until_after(self, time_s: float) -> None:
        """Wait for an estimate of after a time; all of before it have then come."""
        until(lambda: self.estimates and self.estimates[-1]["time_s"] > time_s)

    def between(self, start_s: float, end_s: float) -> list[dict[str, Any]]:
        """The estimates whose time is in a stretch."""
        return [e for e in self.estimates if start_s < e["time_s"] <= end_s]


def children_of(pid: int) -> list[int]:
    """The processes that a process has started and that are still there."""
    found = []
    for status in Path("/proc").glob("[0-9]*/stat"):
        try:
            fields = status.read_text().rsplit(")", 1)[1].split()
        except OSError:
            continue  # it has ended meanwhile
        if int(fields[1]) == pid:
            found.append(int(status.parent.name))
    return found


def is_alive(pid: int) -> bool:
    """Whether a process is there."""
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    return True


@contextmanager
def service(
    folder: Path, launcher: tuple[str, ...] = ("-m", "observer"), **tables: Any
) -> Iterator[tuple[Machine, Daemon, Subscriber]]:
    """Run a machine, the daemon on it with these tables in its configuration, and a subscriber."""
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    with machine() as plant:
        table = table_for(plant.wires, listen=[endpoint]) | tables
        with Daemon(folder, table, launcher) as daemon, Subscriber(endpoint) as seen:
            yield plant, daemon, seen
