"""What the tests of the whole program share."""

from __future__ import annotations

import signal
import sys
from typing import Any

import pytest
import structlog

from observer.cli import main
from observer.process import messages


@pytest.fixture
def command(monkeypatch, tmp_path, capfd):
    """Runs a command line in this process as the program would; gives exit code, output and errors."""
    set_up, interrupted = messages.configure, signal.getsignal(signal.SIGINT)

    def configure(*given: Any, **named: Any) -> None:
        set_up(*given, **named)
        structlog.configure(cache_logger_on_first_use=False)

    def leave(code: int) -> None:
        if code == 2:  # how `run` ends where parts may have been started
            raise SystemExit(code)
        raise AssertionError(f"it started, and left with {code}")

    def run(arguments: list[str]) -> tuple[int, str, str]:
        monkeypatch.setattr(sys, "argv", ["observer", *arguments])
        with pytest.raises(SystemExit) as ended:
            main()
        return ended.value.code, *capfd.readouterr()

    monkeypatch.setattr("observer.process.shutdown.leave", leave)
    monkeypatch.setattr(messages, "configure", configure)
    monkeypatch.chdir(tmp_path)
    yield run
    signal.signal(signal.SIGINT, interrupted)
    structlog.reset_defaults()  # this test's standard error is closed, and others of this process log too
