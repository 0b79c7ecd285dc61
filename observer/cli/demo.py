"""The demo: the service in this process, a simulated machine and a live view each in one of its own."""

from __future__ import annotations

import contextlib
import json
import select
import signal
import subprocess
import sys
import sysconfig
import tempfile
import threading
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, Literal

from observer.bus.session import refuse_taken
from observer.config.outlets import Page, host_and_port
from observer.errors import UserError, has_extra
from observer.installation import Installation, load
from observer.process.terminal import echo

START_S = 20.0
VIEW_END_S = 0.5
PORTS = 100
TERMINATED = 128 + signal.SIGTERM
SYNC_S = 1.0
"""Short, so that recorded data soon show on the page."""
SHOW_CURSOR = "\x1b[?25h"


_FILES = {"screw": "demo.toml", "housings": "demo-housings.toml"}
_MACHINE: dict[str, tuple[str, ...]] = {"screw": (), "housings": ("--housings",)}
"""By the position of the thermocouples: the configuration, and options of the simulated machine."""


def run_demo(
    seconds: float | None,
    listen: str,
    plain: bool,
    page: Page | None,
    record: Path | None = None,
    sensors: Literal["screw", "housings"] = "screw",
) -> int:
    """Run the demo until Ctrl-C or for `seconds`.

    Args:
        seconds: None for no limit.
        listen: Zenoh endpoint of the demo's router.
        plain: Show a line a second instead of the live table.
        page: Where its page listens, by its default on the first free port; None is without.
        record: Folder for the recordings, which are kept; None for one that is removed at the end.
        sensors: Where its thermocouples are: on the screw, or on nut and housings.

    Returns:
        The exit code, 0.

    Raises:
        UserError: A port is taken, the folder cannot be made, or the simulated machine does not start.
    """
    import logging

    import structlog

    from observer.service.daemon import serve

    structlog.configure(wrapper_class=structlog.make_filtering_bound_logger(logging.ERROR))
    config = load(demo_file(sensors))
    refuse_taken((listen,), "--listen")
    name, axis = config.machine.name, config.machine.axis
    key = f"ballscrew/{name}/{axis}/truth/heat"
    page = free_page() if page is not None and "listen" not in page.model_fields_set else page
    if page is not None:
        refuse_taken((f"tcp/{page.listen}",), "--page")
    with (
        recordings(record) as folder,
        simulated_machine("--zenoh", listen, "--key", key, "--can-stamps", *_MACHINE[sensors]) as wires,
    ):
        config = connected(config, wires, listen).model_copy(
            update={
                "page": page,
                "record": config.record.model_copy(update={"directory": folder, "sync_s": SYNC_S}),
                "checkpoint": config.checkpoint.model_copy(update={"enabled": False}),
            }
        )
        lines = [
            *([f"page: http://{page.listen}/"] if page is not None else []),
            *([f"recordings: {folder}"] if record is not None else []),
            f"simulated machine: Modbus TCP on 127.0.0.1:{wires['modbus_port']}, CAN on {wires['can_device']}"
            f"; estimates on {listen} under ballscrew/{name}/{axis}/",
            f"from another terminal: observer watch --connect {listen} --machine {name} --axis {axis}",
            "the service is starting; Ctrl-C ends everything",
        ]
        echo("\n".join(lines))
        with live_view(listen, name, axis, plain):
            serve(config, seconds)
    print("demo ended", flush=True)
    return 0


@contextlib.contextmanager
def recordings(record: Path | None) -> Iterator[Path]:
    """Give the folder to record into.

    Args:
        record: The folder, which is made if it is missing; None for one that is removed after the block, also
            after SIGTERM.

    Raises:
        UserError: The folder cannot be made.
    """
    if record is None:
        # until the service handles signals itself; without this the folder would stay
        before = signal.signal(signal.SIGTERM, lambda *_: sys.exit(TERMINATED))
        try:
            with tempfile.TemporaryDirectory(prefix="observer-demo-") as folder:
                yield Path(folder)
        finally:
            signal.signal(signal.SIGTERM, before)
        return
    try:
        record.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise UserError(f"--record {record}: cannot be made ({error.strerror}); name a folder") from None
    yield record.absolute()


def free_page() -> Page | None:
    """Return a page on the first of 100 ports from the default on; None without its packages or a free
    port.
    """
    if not has_extra("page"):
        return None
    host, first = host_and_port(Page().listen)
    for port in range(first, first + PORTS):
        with contextlib.suppress(UserError):
            refuse_taken((f"tcp/{host}:{port}",), "--page")
            return Page(listen=f"{host}:{port}")
    return None


@contextlib.contextmanager
def live_view(listen: str, machine: str, axis: str, plain: bool) -> Iterator[None]:
    """Show published messages during the block, by a process of its own that ends when its input closes.

    If it ends before, the service continues and reports that on standard error.

    Args:
        listen: Zenoh endpoint of the service.
        machine: Name of the machine.
        axis: Name of the axis.
        plain: A line a second instead of the live table.
    """
    with _child("observer.bus.view", listen, machine, axis, *["--plain"] * plain, end_s=VIEW_END_S) as view:
        ending = threading.Event()

        def watch_over() -> None:
            code = view.wait()
            if not ending.is_set():
                _restore_cursor()
                print(
                    f"observer: the view has ended (exit code {code}); the service continues; "
                    "see it by `observer watch`",
                    file=sys.stderr,
                )

        threading.Thread(target=watch_over, name="view", daemon=True).start()
        try:
            yield
        finally:
            ending.set()


@contextlib.contextmanager
def _child(*command: str, end_s: float, stdout: int | None = None) -> Iterator[subprocess.Popen[bytes]]:
    """Run a module in a process of its own, which ends when its standard input closes."""
    process = subprocess.Popen(
        [sys.executable, "-m", *command],
        stdin=subprocess.PIPE,
        stdout=stdout,
        start_new_session=True,  # Ctrl-C is for the service, which ends the others
    )
    assert process.stdin is not None
    try:
        yield process
    finally:
        process.stdin.close()
        try:
            process.wait(end_s)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
            _restore_cursor()
        if process.stdout is not None:
            process.stdout.close()


def _restore_cursor() -> None:
    """Restore the terminal's cursor, which a killed view has left hidden."""
    if sys.stdout.isatty():
        print(SHOW_CURSOR, end="", flush=True)


def demo_file(sensors: str) -> Path:
    """Return the configuration of the demo: beside the source, or where an installed package keeps it.

    Args:
        sensors: `screw` or `housings`, the place of its thermocouples.
    """
    name = _FILES[sensors]
    checked_out = Path(__file__).parents[2] / "config" / name
    shared = Path(sysconfig.get_path("data")) / "share" / "ballscrew-observer" / name
    return checked_out if checked_out.exists() else shared


@contextlib.contextmanager
def simulated_machine(*options: str) -> Iterator[dict[str, Any]]:
    """Start the simulated machine for the block, and end it by closing its standard input.

    Args:
        options: Those of `python -m drivers.simulated`.

    Yields:
        Its wires: `modbus_port`, `can_device` and others, as the machine prints them.

    Raises:
        UserError: It does not start within 20 s.
    """
    with _child("drivers.simulated", *options, end_s=3.0, stdout=subprocess.PIPE) as process:
        assert process.stdout is not None
        ready, _, _ = select.select([process.stdout], [], [], START_S)
        line = process.stdout.readline() if ready else b""
        if not line:
            raise UserError("demo: the simulated machine did not start; see the lines above for its reason")
        yield json.loads(line)


def connected(config: Installation, wires: Mapping[str, Any], listen: str) -> Installation:
    """Return the demo's configuration with the wires that the simulated machine has.

    Args:
        config: The demo's configuration.
        wires: As `simulated_machine` gives them.
        listen: Zenoh endpoint of the router.
    """
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
