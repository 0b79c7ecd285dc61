"""SIGTERM and SIGINT end a process in time, whatever it hangs in."""

import importlib
import os
import pty
import re
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from observer.process.shutdown import arriving
from tests.patience import Stopwatch, until

WELL = "signals.when_heard(ended.set); print('go', flush=True); ended.wait(30); print('ended', flush=True)"
ASKED = "signals.when_asked(lambda: print('reload', flush=True)); " + WELL
DEAF = "signals.when_heard(lambda: None); print('go', flush=True); [time.sleep(0.01) for _ in range(6000)]"
SCRIPT = """
import threading, time
from observer.process.shutdown import StopSignals
ended = threading.Event()
with StopSignals(lambda: print("flushed", flush=True)) as signals:
    {body}
"""


def _run(body: str, *signals: int) -> tuple[int, str, float]:
    process = subprocess.Popen(
        [sys.executable, "-c", SCRIPT.format(body=body)], stdout=subprocess.PIPE, text=True
    )
    assert process.stdout.readline() == "go\n"
    watch = Stopwatch(process.pid)
    try:
        for number in signals:
            process.send_signal(number)
            until(lambda: not _signals_pending(process.pid))  # two of a kind at once would be one
        took_s = watch.until(lambda: process.poll() is not None)
    finally:
        process.kill()
    return process.returncode, process.communicate()[0], took_s


def _signals_pending(pid: int) -> bool:
    """Whether a process has signals still to take."""
    status = Path(f"/proc/{pid}/status").read_text(encoding="utf-8")
    return int(re.search(r"^ShdPnd:\s*(\w+)", status, re.M)[1], 16) != 0


@pytest.mark.system
@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_a_process_that_listens_ends_by_itself(number):
    code, out, _ = _run(WELL, number)
    assert (code, out) == (0, "ended\n")


@pytest.mark.system
def test_a_process_that_hangs_is_flushed_and_left_within_two_seconds():
    code, out, took_s = _run(DEAF, signal.SIGTERM)
    assert (code, out) == (0, "flushed\n")
    assert took_s < 2.0


@pytest.mark.system
def test_a_second_signal_leaves_at_once():
    code, out, took_s = _run(DEAF, signal.SIGINT, signal.SIGINT)
    assert (code, out) == (0, "flushed\n")
    assert took_s < 1.5  # before the grace of 1.7 s is over


@pytest.mark.system
def test_a_hang_up_asks_for_the_configuration_as_often_as_it_comes():
    process = subprocess.Popen(
        [sys.executable, "-c", SCRIPT.format(body=ASKED)], stdout=subprocess.PIPE, text=True
    )
    try:
        assert process.stdout.readline() == "go\n"
        for _ in range(3):
            process.send_signal(signal.SIGHUP)
            assert process.stdout.readline() == "reload\n"
        process.send_signal(signal.SIGTERM)
        out, _ = process.communicate(timeout=30)
    finally:
        process.kill()
    assert (process.returncode, out) == (0, "ended\n")


@pytest.mark.system
def test_a_hang_up_ends_a_process_that_has_nothing_to_read_again():
    code, out, _ = _run(WELL, signal.SIGHUP)
    assert (code, out) == (0, "ended\n")


@pytest.mark.system
def test_a_hang_up_of_its_terminal_ends_a_process():
    """Closing the window is not asking for a configuration."""
    near, far = pty.openpty()
    process = subprocess.Popen(
        [sys.executable, "-c", SCRIPT.format(body=ASKED)],
        stdin=far,
        stdout=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    os.close(far)
    try:
        assert process.stdout.readline() == "go\n"
        os.close(near)
        process.send_signal(signal.SIGHUP)
        out, _ = process.communicate(timeout=30)
    finally:
        process.kill()
    assert (process.returncode, out) == (0, "ended\n")


@pytest.fixture
def handlers():
    """The handlers of signals, to be as before."""
    before = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGALRM)}
    yield
    for number, handler in before.items():
        signal.signal(number, handler)


def test_what_a_signal_raises_is_raised_behind_an_import(handlers, tmp_path, monkeypatch):
    heard = []
    (tmp_path / "interrupted.py").write_text("import signal; signal.raise_signal(signal.SIGINT); done = True")
    monkeypatch.syspath_prepend(tmp_path)
    signal.signal(signal.SIGINT, arriving(heard.append))
    module = importlib.import_module("interrupted")
    assert module.done
    assert not heard
    until(lambda: heard == [signal.SIGINT])
    signal.raise_signal(signal.SIGINT)
    assert len(heard) == 2, "elsewhere it is raised at once"


@pytest.mark.system
def test_a_hang_up_that_waited_until_the_process_handles_it_asks_for_the_configuration():
    waits = "import os, signal\nsignal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGHUP})\n"
    waits += "os.kill(os.getpid(), signal.SIGHUP)\n"
    body = "ended.wait(0.5); " + ASKED.replace("print('go', flush=True); ", "")  # it begins other parts first
    script = waits + SCRIPT.format(body=body)
    with subprocess.Popen([sys.executable, "-c", script], stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout.readline() == "reload\n"
        process.send_signal(signal.SIGTERM)
        assert process.stdout.read() == "ended\n"
    assert process.returncode == 0
