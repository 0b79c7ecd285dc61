"""Progress of long work where no terminal shows a bar."""

from __future__ import annotations

import pytest

from observer.cli.output import LINE_S, advancing, lines, silent


def test_long_work_prints_a_line_now_and_then(capsys: pytest.CaptureFixture[str]) -> None:
    clock = iter([0.0, 1.0, LINE_S + 0.5, LINE_S + 1.0, 3 * LINE_S])
    print_line = lines("calibrate", lambda: next(clock))
    for stage in ("reading", "fit, prediction 7", "fit, prediction 8", "process noise"):
        print_line(stage)
    printed = capsys.readouterr()
    assert printed.err.splitlines() == [
        "calibrate: fit, prediction 7 (10 s)", "calibrate: process noise (30 s)",
    ]  # fmt: skip
    assert printed.out == ""


def test_short_and_quiet_work_prints_no_line(capsys: pytest.CaptureFixture[str]) -> None:
    with advancing("calibrate") as progress:
        progress("reading")
    with silent(), advancing("calibrate") as progress:
        progress("reading")
    assert capsys.readouterr().err == ""
