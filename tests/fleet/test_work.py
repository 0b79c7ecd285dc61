"""One piece of work: what goes wrong with it stays with it, and it ends in time."""

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from observer.fleet import work as workers
from observer.fleet.jobs import Job
from observer.fleet.journal import WHY, WORK, RunOptions, exclusive, finished_row
from tests.logs.machines import configuration
from tests.logs.simulated import written_log
from tests.patience import PATIENCE_S

HANGING = """
import sys, threading
from pathlib import Path
from observer.fleet import work
from observer.fleet.journal import RunOptions
from observer.fleet.jobs import Job
log, config, output = map(Path, sys.argv[1:])
work._VERBS["replay"] = lambda *_: threading.Event().wait()
work.work([Job("m", "run", (log,), config, Path("m/replay/run"))], RunOptions("replay", output, limit_s=0.2))
"""


@pytest.fixture
def order(tmp_path: Path) -> Job:
    config = configuration(tmp_path, 0, "m")
    log = written_log(config, tmp_path / "run.parquet", 200)
    return Job("m", "run", (log,), config, Path("m/replay/run"))


def test_a_batch_builds_a_machine_once_and_again_for_another_text(tmp_path, order):
    workers._machine.cache_clear()
    how = RunOptions("replay", tmp_path / "out")
    others = [Job("m", f"r{i}", order.logs, order.config, Path(f"m/replay/r{i}")) for i in range(3)]
    rows = workers.work([order, *others], how)
    assert [row["problem"] for row in rows] == [None] * 4
    assert workers._machine.cache_info().misses == 1
    text = order.config.read_text(encoding="utf-8")
    order.config.write_text(text.replace("= 50.0", "= 45.0"), encoding="utf-8")
    (row,) = workers.work([others[0]], how)
    assert row["problem"] is None
    assert workers._machine.cache_info().misses == 2


def test_a_fleet_s_replay_gives_the_bits_of_a_single_one(tmp_path, order):
    import observer

    how = RunOptions("replay", tmp_path / "out")
    workers.work([Job("m", "before", order.logs, order.config, Path("m/replay/before")), order], how)
    observer.load(order.config).replay(order.logs[0]).write(tmp_path / "one", "parquet")
    alone, of_fleet = tmp_path / "one", how.output / order.folder
    for name in ("estimates.parquet", "summary.json"):
        assert (of_fleet / name).read_bytes() == (alone / name).read_bytes()


@pytest.mark.parametrize(
    ("error", "said"),
    [
        (ValueError("odd"), "a defect of the program, ValueError: odd"),
        (MemoryError(), "a defect of the program, MemoryError"),
        (OSError(28, "No space left on device", "x"), "x: No space left on device"),
    ],
)
def test_whatever_a_log_does_its_row_says_so_and_the_next_is_done(tmp_path, order, monkeypatch, error, said):
    def fail(*_: object) -> None:
        raise error

    how, real = RunOptions("replay", tmp_path / "out"), workers._VERBS["replay"]
    broken = Job("m", "b", order.logs, order.config, Path("m/replay/b"))
    work_of = {"b": fail, "run": real}
    monkeypatch.setitem(workers._VERBS, "replay", lambda order, *rest: work_of[order.name](order, *rest))
    first, second = workers.work([broken, order], how)
    assert said in first["problem"]
    assert second["problem"] is None
    assert not list((how.output / WORK).iterdir())
    assert finished_row(broken, how) is None
    assert finished_row(order, how) == second


def test_a_missing_file_is_reported_in_a_sentence(tmp_path, order):
    gone = Job("m", "x", (tmp_path / "x.csv",), order.config, Path("m/replay/x"))
    no_config = Job("m", "y", order.logs, tmp_path / "no.toml", Path("m/replay/y"))
    rows = workers.work([gone, no_config], RunOptions("replay", tmp_path / "out"))
    assert [row["problem"] for row in rows] == [
        f"{tmp_path / 'x.csv'}: no such file; give the path of a log",
        f"{tmp_path / 'no.toml'}: no such file; give the path of a configuration",
    ]


def test_work_left_when_its_run_has_ended_is_dropped(tmp_path, order, monkeypatch):
    others = [Job("m", f"r{i}", order.logs, order.config, Path(f"m/replay/r{i}")) for i in range(2)]
    with exclusive(tmp_path / "out") as folder:
        how, real = RunOptions("replay", tmp_path / "out", run=folder.name), workers._VERBS["replay"]

        def end_meanwhile(*given: object) -> dict:
            shutil.rmtree(folder.parent)  # as the run does that ends
            return real(*given)

        monkeypatch.setitem(workers._VERBS, "replay", end_meanwhile)
        (row,) = workers.work([order, *others], how)
        assert row["problem"] is None
        assert finished_row(order, how) is not None
        assert not folder.parent.exists()


@pytest.mark.system
def test_a_log_that_hangs_ends_its_process_and_is_not_retried(tmp_path, order):
    command = [sys.executable, "-c", HANGING, str(order.logs[0]), str(order.config), str(tmp_path / "out")]
    assert subprocess.run(command, timeout=PATIENCE_S).returncode == workers._EXIT
    how = RunOptions("replay", tmp_path / "out")
    assert len(list((how.output / WORK).glob(f"*/{WHY}"))) == 1
    (row,) = workers.work([order], how)
    assert (
        row["problem"] == f"{order.logs[0]}: not done within 0.2 s; try it alone, or with a longer --limit-s"
    )
