"""Bad input of every kind: a sentence with its remedy for each problem, exit code 2, nothing half-written."""

from __future__ import annotations

import fcntl
import os
import socket
import subprocess
import sys
from pathlib import Path

import pytest

from tests.patience import PATIENCE_S
from tests.system.bad_commands import LOGS, OTHERS, USAGE
from tests.system.bad_configurations import CONFIGURATIONS
from tests.system.bad_inputs import TABLE, Case, changed, rows, text
from tests.system.plant import ROOT, write

pytestmark = pytest.mark.system

EVERY = [*CONFIGURATIONS, *LOGS, *OTHERS]
# One of each command as a process of its own, where also its imports and its exit are the real ones.
PROCESSES = [
    "unknown kind of driver", "missing column", "simulate: channel missing", "calibrate: too short",
    "place: more than sites", "run: a channel without a driver", "watch: bad endpoint", "demo: bad endpoint",
]  # fmt: skip


def _name(case: Case) -> str:
    return case.name


def _tree(folder: Path) -> dict[str, bytes | None]:
    """Every file with its content and every folder below a folder."""
    return {str(p): p.read_bytes() if p.is_file() else None for p in folder.rglob("*")}


def _assert_reported(case: Case, printed: str) -> None:
    first, *rest = printed.splitlines()
    assert first.startswith("observer: ")
    if case.problems == 1:
        assert not rest
    else:
        assert first.endswith(f": {case.problems} problems")
        assert len(rest) == case.problems
        assert all(line.startswith("  ") for line in rest)
    for word in case.words:
        assert word in printed, (word, printed)


@pytest.mark.parametrize("case", EVERY, ids=_name)
def test_bad_input_is_answered_in_one_sentence(case, tmp_path, command):
    arguments = case.arguments(tmp_path)
    before = _tree(tmp_path)
    code, _, errors = command(arguments)
    assert code == 2
    _assert_reported(case, errors)
    assert _tree(tmp_path) == before


@pytest.mark.parametrize("case", USAGE, ids=_name)
def test_a_wrong_option_is_answered_with_the_usage(case, tmp_path, command):
    code, output, errors = command(case.arguments(tmp_path))
    assert code == 2
    assert "Usage: observer" in errors
    assert "Traceback" not in errors
    for word in case.words:
        assert word in errors
    assert output == ""


@pytest.mark.parametrize("case", [c for c in EVERY if c.name in PROCESSES], ids=_name)
def test_and_so_it_is_by_the_program_itself(case, tmp_path):
    arguments = case.arguments(tmp_path)
    before = _tree(tmp_path)
    done = subprocess.run(
        [sys.executable, "-m", "observer", *arguments],
        cwd=tmp_path,
        env=os.environ | {"PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        timeout=PATIENCE_S,
    )
    assert done.returncode == 2
    _assert_reported(case, done.stderr)
    assert _tree(tmp_path) == before


@pytest.mark.parametrize("verb", ["run", "demo"])
def test_a_port_that_another_program_has(verb, tmp_path, command):
    (tmp_path / "log.csv").write_text(text(rows()), encoding="utf-8")
    with socket.create_server(("127.0.0.1", 0)) as other:
        taken = f"tcp/127.0.0.1:{other.getsockname()[1]}"
        player = {"kind": "player", "path": "log.csv"}
        config = write(tmp_path, changed(drivers__log=player, publish={"mode": "router", "listen": [taken]}))
        arguments = {"run": ["--config", str(config)], "demo": ["--listen", taken]}[verb]
        code, _, errors = command([verb, *arguments, "--seconds", "0.5"])
    assert code == 2
    place = {"run": "publish.listen", "demo": "--listen"}[verb]
    assert (
        errors == f"observer: {place}: another program listens on {taken}; stop it or choose another port\n"
    )


def test_a_folder_that_another_service_records_into(tmp_path, command):
    """Two services of one axis on separate networks do not see each other there."""
    (tmp_path / "log.csv").write_text(text(rows()), encoding="utf-8")
    player = {"kind": "player", "path": "log.csv"}
    record = {"directory": str(tmp_path / "kept")}
    config = write(tmp_path, changed(drivers__log=player, record=record))
    recording = tmp_path / "kept" / "machine-x-20260101T000000Z.csv"
    recording.parent.mkdir()
    with recording.open("wb") as other:
        fcntl.flock(other, fcntl.LOCK_EX)
        code, _, errors = command(["run", "--config", str(config), "--seconds", "0.5"])
    assert code == 2
    assert errors == (
        f"observer: record.directory: another service called machine-x is recording {recording}; stop it, or "
        "name another directory\n"
    )


def test_results_of_before_survive_a_replay_that_fails(tmp_path, command):
    """Here the last file, the picture, cannot be put in its place."""
    (tmp_path / "log.csv").write_text(text(rows()), encoding="utf-8")
    (tmp_path / "out" / "overview.png").mkdir(parents=True)
    (tmp_path / "out" / "estimates.csv").write_text("of before", encoding="utf-8")
    config = write(tmp_path, TABLE)
    before = _tree(tmp_path)
    code, _, errors = command(["replay", "log.csv", "--config", str(config), "--output", "out"])
    assert code == 2
    assert "out/overview.png" in errors
    assert _tree(tmp_path) == before


def test_a_quiet_log_says_what_it_cannot_determine(tmp_path, command):
    still = [row if k == 0 else [*row[:3], "0.3", "0"] for k, row in enumerate(rows(800))]
    (tmp_path / "log.csv").write_text(text(still), encoding="utf-8")
    config = write(tmp_path, TABLE)
    code, _, errors = command(["calibrate", "log.csv", "--config", str(config), "--output", "out"])
    assert code == 0, errors
    assert "screw_speed_rpm stays at 0" in errors
