"""Reports readiness and life to the service manager (systemd) without ever waiting for it."""

from __future__ import annotations

import time
from collections.abc import Callable

import sdnotify

_SEND_S = 0.05


def reloading() -> str:
    """Return the message that a process sends before it is executed anew; `READY=1` follows with its first
    estimate.

    It also feeds the watchdog, so that the start has the full time.
    """
    return f"RELOADING=1\nMONOTONIC_USEC={time.monotonic_ns() // 1000}\nWATCHDOG=1"


def service_manager() -> Callable[[str], object]:
    """Return the function that notifies the service manager.

    If the manager does not read, a message is dropped after 50 ms. Its socket holds ten messages. A stalled
    manager must not delay the estimator.
    """
    notifier = sdnotify.SystemdNotifier()
    if notifier.socket is not None:
        notifier.socket.settimeout(_SEND_S)
    notify: Callable[[str], object] = notifier.notify
    return notify
