"""What a daemon, its outlets and `observer --help` do not load."""

from __future__ import annotations

import subprocess
import sys

import pytest

from observer.config.outlets import Metrics, Opcua, Page
from tests.bus.router import free_port
from tests.outlets.feeding import fed_outlets
from tests.system.plant import ROOT, Daemon, Subscriber, machine, table_for

pytestmark = pytest.mark.system
REPORTING = r"""
import os, sys, threading, time
def report():
    while True:
        names = " ".join(name for name, module in list(sys.modules.items()) if module)
        os.write(2, f"\nloaded: {names}\n".encode())  # in one piece: the log writes beside it
        time.sleep(0.1)
threading.Thread(target=report, daemon=True).start()
from observer.cli import main
main()
"""
HELP = """
import sys
from observer.cli import app
app(["--help"], standalone_mode=False)
print("loaded:", *sys.modules)
"""
NEEDLESS = {
    "filterpy", "IPython", "llvmlite", "matplotlib", "numba", "pandas", "PIL", "pyarrow", "pygments", "rich",
    "scipy.integrate", "scipy.linalg", "scipy.optimize", "scipy.signal", "scipy.sparse", "scipy.special",
    "scipy.stats", "statsmodels", "yaml",
}  # fmt: skip


def _loaded(said: str) -> set[str]:
    """The modules that were there when a program said so last."""
    return set([line for line in said.splitlines() if line.startswith("loaded: ")][-1].split()[1:])


def _run(*arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, *arguments], cwd=ROOT, capture_output=True, text=True, check=True, timeout=120
    )


def test_a_daemon_at_work_has_loaded_only_what_it_needs(tmp_path):
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    with machine() as plant:
        table = table_for(plant.wires, mode="router", listen=[endpoint])
        with Daemon(tmp_path, table, ("-c", REPORTING)) as daemon, Subscriber(endpoint) as seen:
            seen.wait_until_good()
            loaded = _loaded(daemon.said())
    assert {"numpy", "pymodbus", "can", "zenoh"} <= loaded
    assert not loaded & NEEDLESS


def test_the_outlets_have_loaded_only_what_they_need(monkeypatch, capfd):
    monkeypatch.setenv("PYTHONPROFILEIMPORTTIME", "1")
    page, metrics, opcua = (f"127.0.0.1:{free_port()}" for _ in range(3))
    outlets = {"page": Page(listen=page), "metrics": Metrics(listen=metrics)}
    with fed_outlets(opcua=Opcua(listen=f"opc.tcp://{opcua}"), **outlets) as feed:
        assert [feed.said()["reason"] for _ in range(3)] == [None] * 3
    lines = [line for line in capfd.readouterr().err.splitlines() if line.startswith("import time:")]
    loaded = {line.rpartition("|")[2].strip() for line in lines}
    assert {"numpy", "starlette.applications", "prometheus_client", "asyncua.ua"} <= loaded
    assert not loaded & (NEEDLESS - {"rich"} | {"rich.traceback"})  # that it was looked for is listed too


def test_help_loads_neither_mathematics_nor_wires():
    done = _run("-c", HELP)
    loaded = _loaded(done.stdout)
    assert "Run the daemon" in done.stdout
    assert "observer.cli" in loaded
    assert not loaded & {"numpy", "pydantic", "scipy", "zenoh", "pymodbus", "can"}
