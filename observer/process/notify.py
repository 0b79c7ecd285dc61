"""Reports readiness and life to the service manager (systemd) without ever waiting for it."""

from __future__ import annotations

from collections.abc import Callable

import sdnotify

_SEND_S = 0.05


def service_manager() -> Callable[[str], object]:
    """Return the function that notifies the service manager; if it does not read, a message is dropped after
    50 ms.

    Its socket holds ten messages. A manager that is held up must not hold up the estimator.
    """
    notifier = sdnotify.SystemdNotifier()
    if notifier.socket is not None:
        notifier.socket.settimeout(_SEND_S)
    notify: Callable[[str], object] = notifier.notify
    return notify
