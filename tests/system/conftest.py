"""What the tests of the whole program share."""

from __future__ import annotations

import sys

import pytest

from observer.cli import main


@pytest.fixture
def command(monkeypatch, tmp_path, capfd):
    """Runs a command line in this process as the program would; gives exit code, output and errors."""

    def leave(code: int) -> None:
        if code == 2:  # how `run` ends where parts may have been started
            raise SystemExit(code)
        raise AssertionError(f"it started, and left with {code}")

    def run(arguments: list[str]) -> tuple[int, str, str]:
        monkeypatch.setattr(sys, "argv", ["observer", *arguments])
        with pytest.raises(SystemExit) as ended:
            main()
        return ended.value.code, *capfd.readouterr()

    monkeypatch.setattr("observer.service.shutdown.leave", leave)
    monkeypatch.chdir(tmp_path)
    return run
