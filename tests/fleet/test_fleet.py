"""`observer fleet` whole: a broken log, kill -9 of the run and of a worker, a cluster that is there."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pyarrow.parquet as pq
import pytest
from distributed import LocalCluster
from typer.testing import CliRunner

from observer.cli import app
from observer.errors import UserError
from observer.fleet import run as running
from observer.fleet.jobs import jobs_of, read_table, rows_of_logs
from observer.fleet.journal import DONE_FILE, RunOptions
from tests.bus.router import free_port
from tests.logs.machines import configuration
from tests.logs.simulated import a_fleet, written_log
from tests.patience import PATIENCE_S, until

pytestmark = pytest.mark.system
MACHINES, LOGS, ROWS = 3, 5, 1500
START_S = 5 * PATIENCE_S  # processes that import everything, on a computer that does much else
LONG_ROWS = 40_000  # takes a second or more, time enough to be killed in


@pytest.fixture(scope="module")
def fleet(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The table of fifteen logs of three machines."""
    return a_fleet(tmp_path_factory.mktemp("fleet"), MACHINES, LOGS, ROWS)


def _command(*arguments: object) -> list[str]:
    return [sys.executable, "-m", "observer", "fleet", *map(str, arguments)]


@contextmanager
def _started(*arguments: object) -> Iterator[subprocess.Popen[str]]:
    process = subprocess.Popen(
        _command(*arguments), stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
    )
    try:
        yield process
    finally:
        process.kill()
        process.wait(PATIENCE_S)
        process.stdout.close()


def _run(*arguments: object) -> subprocess.CompletedProcess[str]:
    return subprocess.run(_command(*arguments), capture_output=True, text=True, timeout=5 * PATIENCE_S)


def _done(output: Path) -> dict[Path, int]:
    """What is done, and when it was. Folders that are in work move, so nobody may walk through them."""
    machines = (folder for folder in output.glob("*/") if folder.name != ".work")
    return {path: path.stat().st_mtime_ns for folder in machines for path in folder.rglob(DONE_FILE)}


def _workers(parent: int) -> list[int]:
    """The worker processes of a run."""
    found = []
    for folder in Path("/proc").glob("[0-9]*"):
        try:
            status = (folder / "stat").read_text().rsplit(")", 1)[1].split()
            if int(status[1]) == parent and b"spawn_main" in (folder / "cmdline").read_bytes():
                found.append(int(folder.name))
        except OSError:
            continue
    return found


def test_a_run_killed_in_the_middle_resumes_and_a_broken_log_is_reported(tmp_path, fleet):
    table, output = tmp_path / "fleet.csv", tmp_path / "out"
    rows = fleet.read_text().splitlines()
    (tmp_path / "broken.csv").write_text("time_s,t1_degC\n1,warm\n")
    lines = [
        rows[0],
        *(
            f"{fleet.parent}/{row.rsplit(',', 1)[0]},{fleet.parent}/{row.rsplit(',', 1)[1]}"
            for row in rows[1:]
        ),
    ]
    table.write_text("\n".join([*lines, f"broken.csv,m000,{fleet.parent}/type-1.toml"]) + "\n")
    with _started("replay", "--table", table, "--output", output, "--workers", 1) as process:
        until(lambda: len(_done(output)) >= 2, START_S)
        process.send_signal(signal.SIGKILL)
        process.wait(PATIENCE_S)
        workers = _workers(process.pid)
    until(lambda: not any(Path(f"/proc/{pid}").exists() for pid in workers))
    before = _done(output)
    assert 2 <= len(before) < MACHINES * LOGS
    for path in before:
        assert {p.name for p in path.parent.iterdir()} == {"estimates.parquet", "summary.json", DONE_FILE}
        assert pq.read_table(path.parent / "estimates.parquet").num_rows == ROWS
    ended = _run("replay", "--table", table, "--output", output)
    assert ended.returncode == 1, ended.stderr
    assert f"15 done, {len(before)} of them before, 1 could not be done" in ended.stdout
    assert "broken.csv: " in ended.stderr
    assert "Traceback" not in ended.stderr
    after = _done(output)
    assert len(after) == MACHINES * LOGS
    assert {path: after[path] for path in before} == before, "nothing is done twice"
    assert sorted(p.name for p in output.iterdir()) == [
        "m000",
        "m001",
        "m002",
        "report.html",
        "results.parquet",
    ]
    found = pq.read_table(output / "results.parquet").to_pylist()
    assert len(found) == MACHINES * LOGS + 1
    (broken,) = (row for row in found if row["problem"])
    assert broken["name"] == "broken"
    assert "broken.csv: " in (output / "report.html").read_text()


@pytest.fixture(scope="module")
def long_and_short(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, list[Path]]:
    """A configuration with a long log and a short one, which nobody here changes."""
    folder = tmp_path_factory.mktemp("long")
    config = configuration(folder, 0, "m")
    short = written_log(config, folder / "short" / "short.parquet", 200)
    return config, [written_log(config, folder / "long" / "long.parquet", LONG_ROWS), short]


def test_the_log_of_a_killed_worker_is_retried_once_and_then_reported(tmp_path, long_and_short):
    config, logs = long_and_short
    output = tmp_path / "out"
    with _started("replay", *logs, "--config", config, "--output", output, "--workers", 1) as process:
        for number in (1, 2):
            # the part of the long log is there once its estimates are being written
            until(lambda number=number: [*output.glob(f".work/*/*.{number}/*/.estimates*")], START_S)
            (worker,) = _workers(process.pid)
            os.kill(worker, signal.SIGKILL)
        said, _ = process.communicate(timeout=5 * PATIENCE_S)
    short, long = output / "m-x/replay/short" / DONE_FILE, output / "m-x/replay/long" / DONE_FILE
    assert short.exists()
    assert not long.exists()
    assert process.returncode == 1, said
    assert "has died 2 times" in said
    assert not (output / ".work").exists()


def test_a_cluster_that_is_there_already_is_used_by_its_address(tmp_path, fleet):
    lines = read_table(fleet)[:4]
    orders, how, progress = jobs_of(lines, "identify"), RunOptions("identify", tmp_path / "out"), []
    with LocalCluster(
        n_workers=1, threads_per_worker=3, processes=False, protocol="tcp", host="127.0.0.1",
        dashboard_address="127.0.0.1:0", local_directory=str(tmp_path / "dask"),
    ) as cluster:  # fmt: skip
        arguments = {"workers": 1, "address": cluster.scheduler_address}
        rows, before = running.run(orders, how, lambda *done: progress.append(done), **arguments)
    assert [row["problem"] for row in rows] == [None] * 4
    assert (before, progress[0], progress[-1]) == (0, (0, 4), (4, 4))
    assert (how.output / orders[0].folder / "heat.parquet").exists()


def test_no_cluster_at_an_address_is_said(tmp_path, fleet, monkeypatch):
    monkeypatch.setattr(running, "WAIT_S", 0.5)
    orders = jobs_of(read_table(fleet)[:1], "replay")
    for address in (f"tcp://127.0.0.1:{free_port()}", "nowhere at all"):
        with pytest.raises(UserError, match="no Dask scheduler answers"):
            running.run(
                orders, RunOptions("replay", tmp_path / "out"), lambda *_: None, workers=1, address=address
            )


def test_nothing_that_could_be_done_is_exit_code_2_as_is_a_wrong_line(tmp_path, fleet):
    config = fleet.parent / "type-1.toml"
    ended = _run(
        "replay", tmp_path / "no.csv", "--config", config, "--output", tmp_path / "out", "--workers", 1
    )
    assert ended.returncode == 2
    assert "no.csv: no such file" in ended.stderr
    command = ["fleet", "replay", tmp_path / "no.csv", "--table", fleet, "--output", tmp_path / "out"]
    wrong = CliRunner().invoke(app, [str(word) for word in command])
    assert isinstance(wrong.exception, UserError)
    assert "name either logs with --config" in str(wrong.exception)


def test_a_machine_is_calibrated_by_all_of_its_logs(tmp_path, fleet):
    config = fleet.parent / "type-1.toml"
    logs = sorted((fleet.parent / "m000").glob("*.parquet"))[:2]
    how = RunOptions("calibrate", tmp_path / "out")
    (order,) = jobs_of(rows_of_logs(logs, config), "calibrate")
    from observer.fleet.work import work

    (row,) = work([order], how)
    assert row["problem"] is None
    result = json.loads((how.output / "type-1-x" / "calibrate" / "calibration.json").read_text())
    assert row["found"]["calibrated"] == result["calibrated"]
    assert result["logs"] == ["run-000.parquet", "run-001.parquet"]


@pytest.mark.parametrize(
    ("number", "code"), [(signal.SIGINT, 130), pytest.param(signal.SIGTERM, 143, marks=pytest.mark.slow)]
)
def test_ctrl_c_keeps_finished_work_in_one_sentence_and_leaves_no_process(
    tmp_path, long_and_short, number, code
):
    config, logs = long_and_short
    output = tmp_path / "out"
    command = _command("replay", *logs, "--config", config, "--output", output, "--workers", 1)
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, start_new_session=True
    ) as process:
        try:
            until(lambda: [*output.glob(".work/*/*.1/*/.estimates*")], START_S)
            workers = _workers(process.pid)
            os.killpg(process.pid, number)  # as a terminal sends it, to the workers too
            said, _ = process.communicate(timeout=PATIENCE_S)
        finally:
            process.kill()
    assert process.returncode == code, said
    assert (
        said == "observer: fleet replay: ended with 0 of 2 done; the same command continues with the rest\n"
    )
    assert len(workers) == 1
    until(lambda: not any(Path(f"/proc/{pid}").exists() for pid in workers))
    assert sorted(path.name for path in output.iterdir()) == ["report.html", "results.parquet"]
