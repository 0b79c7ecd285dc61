"""What is done stays done until something it was made of changes; what is half done is not done."""

import os
import shutil
from dataclasses import replace
from pathlib import Path

import pytest
from pyarrow import parquet

from observer.errors import UserError
from observer.fleet.jobs import Job
from observer.fleet.journal import (
    WHY,
    WORK,
    GivenUpError,
    RunOptions,
    begin,
    exclusive,
    finish,
    finished_row,
    provenance,
    rows_in,
)
from observer.fleet.report import conclude


@pytest.fixture
def order(tmp_path: Path) -> Job:
    (tmp_path / "run.csv").write_text("time_s\n1\n")
    (tmp_path / "c.toml").write_text("a = 1\n")
    return Job("m", "run", (tmp_path / "run.csv",), tmp_path / "c.toml", Path("m/replay/run"))


@pytest.fixture
def how(tmp_path: Path) -> RunOptions:
    return RunOptions("replay", tmp_path / "out")


def _do(order: Job, how: RunOptions, number: int = 1) -> None:
    part = begin(order, how)
    (part / "estimates.parquet").write_text(str(number))
    finish(part, order, how, provenance(order, how), {"number": number, "found": {}})


def test_finished_work_has_its_row_and_results_and_nothing_else_is_left(order, how):
    assert finished_row(order, how) is None
    _do(order, how)
    assert finished_row(order, how) == {"number": 1, "found": {}}
    assert sorted(p.name for p in (how.output / order.folder).iterdir()) == ["done.json", "estimates.parquet"]
    assert not list((how.output / WORK).iterdir())
    assert list(rows_in(how.output)) == [{"number": 1, "found": {}}]
    _do(order, how, 2)
    assert (how.output / order.folder / "estimates.parquet").read_text() == "2"


def test_a_fresh_copy_of_a_log_is_the_same_and_other_content_is_not(order, how):
    _do(order, how)
    log, config = order.logs[0], order.config
    os.utime(log, (1, 1))
    assert finished_row(order, how)
    log.write_text("time_s\n2\n")
    assert finished_row(order, how) is None
    log.write_text("time_s\n1\n")
    assert finished_row(order, how)
    config.write_text("a = 2\n")
    assert finished_row(order, how) is None
    config.write_text("a = 1\n")
    log.unlink()
    assert finished_row(order, how) is None


def test_other_options_are_other_work(order, how):
    _do(order, how)
    assert finished_row(order, RunOptions("replay", how.output, limit_s=5.0)), (
        "the time that it may take changes no result"
    )
    assert finished_row(order, RunOptions("replay", how.output, format="csv")) is None


@pytest.mark.parametrize("text", ["", "{", "[]", '{"made_of": 1, "row": {}}', "null"])
def test_a_damaged_file_counts_as_not_done(order, how, text):
    _do(order, how)
    (how.output / order.folder / "done.json").write_text(text)
    assert finished_row(order, how) is None
    assert list(rows_in(how.output)) in ([], [{}])


def test_two_tries_that_died_are_enough(order, how):
    first = begin(order, how)
    second = begin(order, how)
    assert first != second
    with pytest.raises(GivenUpError, match="the process that worked on it has died 2 times"):
        begin(order, how)


def test_the_second_try_may_succeed_and_nothing_is_left_of_the_first(order, how):
    begin(order, how)
    _do(order, how)
    assert finished_row(order, how)
    assert not list((how.output / WORK).iterdir())


def test_what_was_ended_for_its_time_is_not_tried_again(order, how):
    (begin(order, how) / WHY).write_text("run.csv: not done within 3 s")
    with pytest.raises(GivenUpError, match="not done within 3 s"):
        begin(order, how)


def test_a_folder_is_for_one_run_alone_and_a_killed_one_leaves_no_tries(order, how):
    with exclusive(how.output) as work:
        begin(order, how)
        with pytest.raises(UserError, match="another run is working there"), exclusive(how.output):
            pass
        kept = how.output / "kept"
        shutil.copytree(work, kept)
    assert not list(how.output.glob(".*"))
    shutil.move(kept, work)  # as a kill -9 leaves it
    with exclusive(how.output) as work:
        assert [path.name for path in work.iterdir()] == ["alive"]  # by which workers know that it goes on


def test_results_that_stand_under_a_former_name_count_once(order, how):
    """A log may have changed places among others of its name."""
    former = replace(order, folder=Path("m/replay/run-0a1b2c3d"))
    for each in (former, order):
        row = {
            "machine": "m", "verb": "replay", "name": "run", "logs": [str(order.logs[0])], "config": "c",
            "folder": str(each.folder), "problem": None, "seconds": 1.0,
            "found": {"type": "t", "heat_mean_W": {}, "sources": []},
        }  # fmt: skip
        finish(begin(each, how), each, how, provenance(each, how), row)
    assert len(list(rows_in(how.output))) == 2
    assert conclude(how.output, [row]) == []
    assert parquet.read_table(how.output / "results.parquet").to_pydict()["folder"] == ["m/replay/run"]
