"""Ctrl-C in a command that works on logs: it goes to all of its processes, as a terminal sends it."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from tests.patience import PATIENCE_S, computed_s, until

pytestmark = pytest.mark.system
RIG = Path(__file__).parents[1] / "data" / "rig"


def _second(pid: int) -> int | None:
    """The process that searches beside, once there is one."""
    for child in Path(f"/proc/{pid}/task/{pid}/children").read_text().split():
        if "spawn_main" in Path(f"/proc/{child}/cmdline").read_text():
            return int(child)
    return None


@pytest.mark.parametrize("after_s", [0.02, 2.0], ids=["while it starts", "at work"])
def test_a_search_ends_without_a_word_of_its_second_process(after_s, tmp_path):
    logs = sorted(RIG.rglob("run_*.csv.gz"))
    assert len(logs) > 2, "a search of one log may be over before it is interrupted"
    command = [sys.executable, "-m", "observer", "discover", *map(str, logs)]
    command += ["--config", str(RIG / "config.toml"), "--output", str(tmp_path / "found")]
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, start_new_session=True
    ) as process:
        second = until(lambda: _second(process.pid))
        until(lambda: computed_s(second) >= after_s)
        os.killpg(process.pid, signal.SIGINT)
        said, _ = process.communicate(timeout=PATIENCE_S)
    assert process.returncode == 130
    assert said == ""
    assert not list(tmp_path.iterdir())
    until(lambda: not Path(f"/proc/{second}").exists())
