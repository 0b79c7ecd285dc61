"""Runs pytest again and again in forks of one process that has the libraries loaded, which takes longest.

Started as `python -m campaigns.mutants.forks` in a copy of the tree. Each line of standard input is a list of
pytest's arguments and the seconds it may take; each is answered by the exit code, or -1 where it took longer.
"""

from __future__ import annotations

import importlib
import json
import os
import signal
import sys
import time

LIBRARIES = (
    "numpy", "scipy.linalg", "scipy.optimize", "scipy.sparse.linalg", "scipy.special", "pydantic",
    "tomlkit", "cbor2", "pyarrow.csv", "rich.console", "structlog", "control", "hypothesis.extra.numpy",
)  # fmt: skip


def main() -> None:
    """Answer until the input ends."""
    for name in LIBRARIES:
        importlib.import_module(name)
    for line in sys.stdin:
        arguments, limit_s = json.loads(line)
        print(_run(arguments, limit_s), flush=True)


def _run(arguments: list[str], limit_s: float) -> int:
    child = os.fork()
    if child == 0:
        _child(arguments)
    until_s = time.monotonic() + limit_s
    while time.monotonic() < until_s:
        found, status = os.waitpid(child, os.WNOHANG)
        if found:
            return os.waitstatus_to_exitcode(status)
        time.sleep(0.02)
    os.killpg(child, signal.SIGKILL)
    os.waitpid(child, 0)
    return -1


def _child(arguments: list[str]) -> None:
    os.setsid()
    nothing = os.open(os.devnull, os.O_RDWR)
    for stream in (0, 1, 2):
        os.dup2(nothing, stream)
    import pytest

    code = 1
    try:
        code = pytest.main(arguments)
    finally:
        os._exit(int(code))


if __name__ == "__main__":
    main()
