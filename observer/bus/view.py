"""The live view: a subscriber like any other, in the terminal of whoever looks.

`python -m observer.bus.view ENDPOINT MACHINE AXIS` runs until its standard input closes, for a demo
that keeps its view in a process of its own: drawing must not delay the wires.
"""

from __future__ import annotations

import argparse
import os
import sys
import threading
from typing import TYPE_CHECKING

from observer.config.publishing import Client
from observer.process.terminal import echo, printable_console

if TYPE_CHECKING:
    from observer.bus.watch import Subscription

REFRESH_S = 0.25
PLAIN_S = 1.0


def watch(endpoint: str, machine: str, axis: str, seconds: float | None, client: Client | None = None) -> int:
    """Show a running service until Ctrl-C or for `seconds`.

    It waits for a router that is not there yet. Without a terminal it prints a line a second.

    Args:
        endpoint: Zenoh endpoint of the service or a router.
        machine: Name of the machine; `*` for any.
        axis: Name of the axis; `*` for any.
        seconds: None for no limit.
        client: Credentials; None without any.

    Returns:
        The exit code: 0, or 2 if nothing came, with the reason on standard error.
    """
    stop = threading.Event()
    if seconds is not None:
        timer = threading.Timer(seconds, stop.set)
        timer.daemon = True
        timer.start()
    try:
        problem = _view(endpoint, machine, axis, not sys.stdout.isatty(), stop, client)
    except KeyboardInterrupt:
        return 0
    if problem is not None:
        echo(f"observer: {problem}", err=True)
    return 0 if problem is None else 2


def _view(
    endpoint: str,
    machine: str,
    axis: str,
    plain: bool,
    stop: threading.Event,
    client: Client | None = None,
) -> str | None:
    """Show what is published until `stop`; a router that is not there yet is waited for.

    Says why nothing came, None if something did.
    """
    import zenoh

    from observer.bus.watch import Subscription

    silence = f"nothing heard at {endpoint}; start the service, or name it with --connect"
    while not stop.is_set():
        try:
            with Subscription((endpoint,), machine, axis, client) as subscription:
                _show(subscription, plain, stop)
                return None if subscription.latest() else subscription.absent() or silence
        except zenoh.ZError:
            stop.wait(0.3)
    return silence


def _show(subscription: Subscription, plain: bool, stop: threading.Event) -> None:
    """Draw the newest messages again and again, before the first of them who else is there."""
    from rich.live import Live
    from rich.text import Text

    from observer.bus.watch import live_line, live_table

    console = printable_console()
    if plain:
        while not stop.wait(PLAIN_S):
            if line := live_line(subscription.latest()):
                console.print(line, markup=False, highlight=False, soft_wrap=True)
        return
    with Live(live_table({}), console=console, refresh_per_second=1 / REFRESH_S, screen=False) as live:
        while not stop.wait(REFRESH_S):
            latest = subscription.latest()
            instead = None if latest else subscription.absent()
            live.update(Text(instead, style="yellow") if instead else live_table(latest))


def main() -> None:
    """Show an axis until the standard input closes; the process is left without waiting for threads."""
    from observer.process.shutdown import leave

    parser = argparse.ArgumentParser(prog="python -m observer.bus.view")
    for name in ("endpoint", "machine", "axis"):
        parser.add_argument(name)
    parser.add_argument("--plain", action="store_true")
    args = parser.parse_args()
    stop = threading.Event()

    def until_closed() -> None:
        while os.read(sys.stdin.fileno(), 1024):
            pass
        stop.set()

    threading.Thread(target=until_closed, daemon=True).start()
    try:
        _view(args.endpoint, args.machine, args.axis, args.plain, stop)
    except OSError:  # nobody reads what is shown any more
        leave(1)
    leave(0)


if __name__ == "__main__":
    main()
