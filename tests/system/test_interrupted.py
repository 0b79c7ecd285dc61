"""Ctrl-C in a command that works on logs: it goes to all of its processes, as a terminal sends it."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from tests.patience import PATIENCE_S, computed_s, until

pytestmark = pytest.mark.system
RIG = Path(__file__).parents[1] / "data" / "rig"
AT_WORK_S = 1.0  # of processor time; it begins with a third of this, and waits for its first work


def _second(pid: int) -> int | None:
    """The process that searches beside, once there is one."""
    for child in Path(f"/proc/{pid}/task/{pid}/children").read_text().split():
        if "workers import serve" in Path(f"/proc/{child}/cmdline").read_text():
            return int(child)
    return None


def _logs() -> list[Path]:
    """Those of one machine: what the first process does alone lasts longer with each log."""
    logs = sorted((RIG / "end_conduction-0.1").glob("run_*.csv.gz"))
    assert len(logs) > 2, "a search of one log may be over before it is interrupted"
    return logs


@contextmanager
def _started(
    verb: str, logs: list[Path], output: Path, **environment: str
) -> Iterator[subprocess.Popen[str]]:
    """A command in a process group of its own."""
    # whoever runs the tests in the background may have the processes ignore it
    command = ["env", "--default-signal=INT", sys.executable, "-m", "observer", verb, *map(str, logs)]
    process = subprocess.Popen(
        [*command, "--config", str(RIG / "config.toml"), "--output", str(output)],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        start_new_session=True,
        env=os.environ | environment,
    )
    with process:
        try:
            yield process
        finally:
            process.kill()


def _lasts(process: subprocess.Popen[str]) -> bool:
    """Whether a process is there after a moment."""
    try:
        process.wait(0.05)
    except subprocess.TimeoutExpired:
        return True
    return False


@pytest.mark.parametrize("often", [False, True], ids=["once", "again and again"])
@pytest.mark.parametrize("after_s", [0.02, AT_WORK_S], ids=["while it starts", "at work"])
def test_a_search_ends_without_a_word_of_its_second_process(after_s, often, tmp_path):
    with _started("discover", _logs(), tmp_path / "found") as process:
        second = until(lambda: _second(process.pid))
        until(lambda: computed_s(second) >= after_s)
        os.killpg(process.pid, signal.SIGINT)
        while often and _lasts(process):
            os.killpg(process.pid, signal.SIGINT)
        printed, _ = process.communicate(timeout=PATIENCE_S)
    progress = re.compile(r"discover: .+ \(\d+ s\)")  # of a computer so busy that it takes long
    assert (process.returncode, [x for x in printed.splitlines() if not progress.fullmatch(x)]) == (130, [])
    assert not list(tmp_path.iterdir())
    until(lambda: not Path(f"/proc/{second}").exists())


@pytest.mark.slow
@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGKILL])
def test_the_second_process_ends_with_a_search_that_is_killed(number, tmp_path):
    with _started("discover", _logs(), tmp_path / "found") as process:
        second = until(lambda: _second(process.pid))
        until(lambda: computed_s(second) >= AT_WORK_S)
        process.send_signal(number)
        process.communicate(timeout=PATIENCE_S)
    until(lambda: not Path(f"/proc/{second}").exists())


_SWALLOWS_IT = """
import os, signal, time
try:
    os.killpg(0, signal.SIGINT)
    time.sleep(0.01)
except KeyboardInterrupt:
    pass
raise ImportError
"""


@pytest.mark.parametrize("verb", ["replay", "identify", "calibrate", "discover"])
def test_ctrl_c_is_not_lost_while_a_library_is_loaded(verb, tmp_path):
    """Arrow looks for pandas when it has read a log; compiled modules of that swallow what is raised."""
    (tmp_path / "pandas").mkdir()
    (tmp_path / "pandas" / "__init__.py").write_text(_SWALLOWS_IT)
    path = os.pathsep.join((str(tmp_path), os.environ.get("PYTHONPATH", "")))
    logs = _logs() if verb in ("calibrate", "discover") else _logs()[:1]
    with _started(verb, logs, tmp_path / "found", PYTHONPATH=path) as process:
        said, _ = process.communicate(timeout=PATIENCE_S)
    assert (process.returncode, said) == (130, "")
    assert [file.name for file in tmp_path.iterdir()] == ["pandas"]
