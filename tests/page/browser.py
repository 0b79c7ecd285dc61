"""Headless Chromium and a service with a page, for tests and for the pictures of the documentation."""

from __future__ import annotations

import ssl
import time
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from tests.bus.router import free_port
from tests.patience import PATIENCE_S, until
from tests.system.plant import Daemon, Subscriber, machine, table_for

CHROMIUM = Path("/usr/bin/chromium")
IN_A_BROWSER = [
    pytest.mark.system,
    pytest.mark.skipif(not CHROMIUM.exists(), reason="needs Debian's package chromium"),
]
ARGS = (
    "--no-sandbox", "--disable-gpu", "--disable-background-networking", "--disable-component-update",
    "--disable-sync", "--no-first-run", "--disable-quic",
)  # fmt: skip
PERIOD_S, SENSORS_S = 0.5, 1.0
SIZES = {"phone": (390, 844), "tablet": (820, 1180), "desktop": (1440, 900), "wall": (2560, 1440)}


@contextmanager
def chromium() -> Iterator[Any]:
    """A browser of Debian's package, without a window."""
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=str(CHROMIUM), args=list(ARGS))
        try:
            yield browser
        finally:
            browser.close()


def complaints(page: Any) -> list[str]:
    """A list that takes whatever a page complains of: errors, warnings and dialogs."""
    problems: list[str] = []
    page.on("console", lambda m: problems.append(m.text) if m.type in {"error", "warning"} else None)
    page.on("pageerror", lambda error: problems.append(str(error)))
    page.on("dialog", lambda dialog: problems.append(dialog.message))
    return problems


@contextmanager
def service(folder: Path, **page: Any) -> Iterator[tuple[str, Daemon, Subscriber]]:
    """A daemon with a page on a simulated machine: the page's address, the daemon, and who hears Zenoh.

    Its thermocouples are read less often than the estimator steps.
    """
    endpoint, listen = f"tcp/127.0.0.1:{free_port()}", f"127.0.0.1:{free_port()}"
    with machine() as simulated:
        table = table_for(simulated.wires, mode="router", listen=[endpoint])
        table["estimator"]["period_s"] = PERIOD_S
        table["drivers"]["thermocouples"]["period_s"] = SENSORS_S
        table["page"] = {"listen": listen, **page}
        with Daemon(folder, table) as daemon, Subscriber(endpoint) as seen:
            until(lambda: seen.estimates, 2 * PATIENCE_S)
            until(lambda: answers(f"http://{listen}/assets/page.css"), PATIENCE_S)
            yield f"http://{listen}/", daemon, seen


def answers(url: str, trusted: ssl.SSLContext | None = None) -> bool:
    """Whether something is served there."""
    try:
        with urllib.request.urlopen(url, timeout=2, context=trusted) as answer:
            return bool(answer.status == 200)
    except OSError:
        return False


def seconds_until(page: Any, script: str) -> float:
    """How long until an expression in the page is true."""
    start_s = time.monotonic()
    page.wait_for_function(script, timeout=PATIENCE_S * 1000, polling=50)
    return time.monotonic() - start_s
