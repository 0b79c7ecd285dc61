"""The demo: a simulated machine in its own process, the service in this one, and a live view of both."""

from __future__ import annotations

import contextlib
import json
import subprocess
import sys
import sysconfig
import threading
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

from observer.config import Config, load
from observer.endpoints import refuse_taken
from observer.errors import UserError
from observer.publishing import Client

START_S = 20.0
REFRESH_S = 0.25
PLAIN_S = 1.0


def run_demo(seconds: float | None, listen: str, plain: bool) -> int:
    """Run the demo until Ctrl-C or for `seconds`; returns the exit code. Raises `UserError`."""
    import logging

    import structlog

    from observer import app

    structlog.configure(wrapper_class=structlog.make_filtering_bound_logger(logging.ERROR))
    config = load(demo_file())
    refuse_taken((listen,), "--listen")
    name, axis = config.machine.name, config.machine.axis
    key = f"ballscrew/{name}/{axis}/truth/heat"
    with simulated_machine("--zenoh", listen, "--key", key) as wires:
        config = connected(config, wires, listen)
        print(
            f"simulated machine: Modbus TCP on 127.0.0.1:{wires['modbus_port']}, CAN on {wires['can_device']}"
            f"; estimates on {listen} under ballscrew/{name}/{axis}/",
            flush=True,
        )
        done = threading.Event()
        view = threading.Thread(
            target=_view, args=(listen, name, axis, plain, done), name="view", daemon=True
        )
        view.start()
        app.serve(config, seconds)
        done.set()
        view.join(1.0)
    print("demo ended", flush=True)
    return 0


def demo_file() -> Path:
    """Return the demo's configuration: beside the source, or where an installed package keeps it."""
    beside = Path(__file__).parent.parent / "config" / "demo.toml"
    shared = Path(sysconfig.get_path("data")) / "share" / "ballscrew-observer" / "demo.toml"
    return beside if beside.exists() else shared


@contextlib.contextmanager
def simulated_machine(*options: str) -> Iterator[dict[str, Any]]:
    """Start the simulated machine; yields its wires, and ends it by closing its standard input."""
    process = subprocess.Popen(
        [sys.executable, "-m", "drivers.simulated", *options],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        start_new_session=True,  # Ctrl-C ends the service first, which then ends the machine
    )
    assert process.stdin is not None
    assert process.stdout is not None
    try:
        line = _first_line(process, START_S)
        if not line:
            raise UserError("demo: the simulated machine did not start; see the lines above for its reason")
        yield json.loads(line)
    finally:
        process.stdin.close()
        try:
            process.wait(3.0)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
        process.stdout.close()


def _first_line(process: subprocess.Popen[bytes], timeout_s: float) -> bytes:
    lines: list[bytes] = []
    assert process.stdout is not None
    reader = threading.Thread(
        target=lambda out: lines.append(out.readline()), args=(process.stdout,), daemon=True
    )
    reader.start()
    reader.join(timeout_s)
    return lines[0] if lines else b""


def connected(config: Config, wires: Mapping[str, Any], listen: str) -> Config:
    """Return the demo's configuration with the wires that the simulated machine has."""
    thermocouples, axis = config.drivers["thermocouples"], config.drivers["axis"]
    return config.model_copy(
        update={
            "drivers": {
                "thermocouples": thermocouples.model_copy(update={"port": wires["modbus_port"]}),
                "axis": axis.model_copy(update={"channel": wires["can_device"]}),
            },
            "publish": config.publish.model_copy(update={"mode": "router", "listen": (listen,)}),
        }
    )


def watch(endpoint: str, machine: str, axis: str, seconds: float | None, client: Client | None = None) -> int:
    """Show a running service until Ctrl-C or for `seconds`; returns the exit code."""
    done = threading.Event()
    if seconds is not None:
        timer = threading.Timer(seconds, done.set)
        timer.daemon = True
        timer.start()
    try:
        heard = _view(endpoint, machine, axis, not sys.stdout.isatty(), done, client)
    except KeyboardInterrupt:
        return 0
    if not heard:
        print(
            f"observer: nothing heard at {endpoint}; start the service, or name it with --connect",
            file=sys.stderr,
        )
    return 0 if heard else 2


def _view(
    endpoint: str,
    machine: str,
    axis: str,
    plain: bool,
    done: threading.Event,
    client: Client | None = None,
) -> bool:
    """Show what is published until `done`; a router that is not there yet is waited for. Says if any came."""
    import zenoh

    from observer.publish.watch import Subscription

    while not done.is_set():
        try:
            with Subscription((endpoint,), machine, axis, client) as subscription:
                return _show(subscription.latest, plain, done)
        except zenoh.ZError:
            done.wait(0.3)
    return False


def _show(latest: Callable[[], dict[str, dict[str, Any]]], plain: bool, done: threading.Event) -> bool:
    """Draw the newest messages again and again."""
    from rich.console import Console
    from rich.live import Live

    from observer.publish.watch import live_line, live_table

    console = Console()
    if plain:
        while not done.wait(PLAIN_S):
            if line := live_line(latest()):
                console.print(line, markup=False, highlight=False, soft_wrap=True)
        return bool(latest())
    with Live(live_table({}), console=console, refresh_per_second=1 / REFRESH_S, screen=False) as live:
        while not done.wait(REFRESH_S):
            live.update(live_table(latest()))
        return bool(latest())
