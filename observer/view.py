"""The live view: a subscriber like any other, in the terminal of whoever looks.

`python -m observer.view ENDPOINT MACHINE AXIS` runs until its standard input closes, for a demo that keeps
its view in a process of its own: drawing must not delay the wires.
"""

from __future__ import annotations

import argparse
import os
import sys
import threading
from collections.abc import Callable
from typing import Any

from observer.tables.publishing import Client

REFRESH_S = 0.25
PLAIN_S = 1.0


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


def main() -> None:
    """Show an axis until the standard input closes."""
    from observer.service.shutdown import leave

    parser = argparse.ArgumentParser(prog="python -m observer.view")
    for name in ("endpoint", "machine", "axis"):
        parser.add_argument(name)
    parser.add_argument("--plain", action="store_true")
    args = parser.parse_args()
    done = threading.Event()

    def until_closed() -> None:
        while os.read(sys.stdin.fileno(), 1024):
            pass
        done.set()

    threading.Thread(target=until_closed, daemon=True).start()
    try:
        _view(args.endpoint, args.machine, args.axis, args.plain, done)
    except OSError:  # nobody reads what is shown any more
        leave(1)
    leave(0)


if __name__ == "__main__":
    main()
