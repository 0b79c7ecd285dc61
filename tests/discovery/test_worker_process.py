"""The worker beside programs of every kind: a script without a guard, standard input, a notebook."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path

import nbformat
import pytest
from nbclient import NotebookClient

from observer.discovery.workers import WorkerPool
from tests.discovery.small import problem_of
from tests.logs.machines import machine
from tests.logs.simulated import made_log
from tests.patience import PATIENCE_S, until

ROOT = Path(__file__).parents[2]
PROGRAM = """\
from pathlib import Path
from observer.discovery.workers import WorkerPool
from tests.discovery.test_worker_process import met, small_problem
print("begun")
with WorkerPool() as pool:
    print(len(set(pool.map(met, small_problem(), [(Path({folder!r}),)] * 2))), "processes")
"""


def small_problem():
    config = machine()
    return problem_of(config, [made_log(config, 0, minutes=20.0)])


def met(_problem, folder: Path) -> int:
    """Wait for another process that does the same."""
    (folder / str(os.getpid())).touch()
    until(lambda: len(list(folder.iterdir())) == 2)
    return os.getpid()


def alone(_problem, folder: Path, first: int) -> int:
    """As a worker, say so and never end; as the first process, wait for that and end the worker."""
    if os.getpid() == first:
        until(lambda: any(folder.iterdir()))
        (worker,) = folder.iterdir()
        os.kill(int(worker.name), signal.SIGKILL)
    else:
        (folder / str(os.getpid())).touch()
        signal.pause()
    return os.getpid()


@pytest.mark.system
@pytest.mark.parametrize("way", ["script", "standard input", "-c"])
def test_a_program_needs_no_guard(tmp_path: Path, way: str) -> None:
    (tmp_path / "met").mkdir()
    text = PROGRAM.format(folder=str(tmp_path / "met"))
    script = tmp_path / "study.py"
    script.write_text(text)
    words = {"script": [str(script)], "standard input": ["-"], "-c": ["-c", text]}[way]
    done = subprocess.run(
        [sys.executable, *words],
        input=text if way == "standard input" else "",
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        cwd=tmp_path,
        capture_output=True,
        text=True,
        timeout=PATIENCE_S,
    )
    assert (done.stdout, done.stderr) == ("begun\n2 processes\n", "")


@pytest.mark.system
def test_a_notebook_has_a_worker(tmp_path: Path) -> None:
    (tmp_path / "met").mkdir()
    cell = nbformat.v4.new_code_cell(
        f"import sys; sys.path.insert(0, {str(ROOT)!r})\n" + PROGRAM.format(folder=str(tmp_path / "met"))
    )
    book = nbformat.v4.new_notebook(cells=[cell])
    NotebookClient(book, timeout=PATIENCE_S, resources={"metadata": {"path": str(tmp_path)}}).execute()
    assert {output.name for output in book.cells[0].outputs} == {"stdout"}
    assert "".join(output.text for output in book.cells[0].outputs) == "begun\n2 processes\n"


@pytest.mark.system
def test_what_a_killed_worker_had_to_do_is_done_here(tmp_path: Path) -> None:
    tasks = [(tmp_path, os.getpid())] * 3
    with WorkerPool() as pool:
        # the first task is done here, and waits until the second is under way there
        assert pool.map(alone, small_problem(), tasks) == [os.getpid()] * 3


@pytest.mark.system
def test_the_worker_ends_with_a_program_that_is_killed(tmp_path: Path) -> None:
    program = PROGRAM.format(folder=str(tmp_path)).replace("met", "alone").replace(",)", ", 0)")
    with subprocess.Popen([sys.executable, "-c", program], cwd=ROOT, stdout=subprocess.DEVNULL) as process:
        until(lambda: len(list(tmp_path.iterdir())) == 2)
        process.kill()
    (worker,) = {int(file.name) for file in tmp_path.iterdir()} - {process.pid}
    until(lambda: not Path(f"/proc/{worker}").exists())


def _fails(_problem, _number: int) -> None:
    raise LookupError("on purpose")


def test_what_fails_there_fails_here_with_its_own_error() -> None:
    with WorkerPool() as pool, pytest.raises(LookupError, match="on purpose"):
        pool.map(_fails, small_problem(), [(1,), (2,)])
