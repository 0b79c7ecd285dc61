"""A worker process that fits hypotheses in parallel with this one; threads would share one interpreter lock.

The worker is a separate interpreter that gets the same import path. It never imports the program that started
it. So that program may be a script without a guard, a notebook, or standard input.
"""

from __future__ import annotations

import io
import multiprocessing
import os
import pickle
import queue
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import suppress
from multiprocessing.connection import Connection
from typing import Any, Self

from observer.fit.problem import Problem
from observer.process.signals import blocked

Work = Callable[..., Any]
Task = tuple[Any, ...]
_START = (
    "import sys; sys.path[:] = sys.argv[2:]; "
    "from observer.discovery.workers import serve; serve(int(sys.argv[1]))"
)
_NOT_DONE = b""
"""The answer to what the worker cannot do; the same work, done in this process, shows why."""
_problems: list[Problem] = []
"""The problem that all tasks share: the worker gets it once, tasks and results only refer to it."""


class _Pickler(pickle.Pickler):
    def persistent_id(self, value: object) -> str | None:
        """Return a reference in place of the shared problem."""
        return "problem" if _problems and value is _problems[0] else None


class _Unpickler(pickle.Unpickler):
    def persistent_load(self, _reference: str) -> Problem:
        """Return the shared problem."""
        return _problems[0]


class WorkerPool:
    """Runs tasks on one problem in this process and one worker, with the same results as this process alone.

    Results are the same up to rounding: a BLAS may choose the order of a sum by where arrays lie in memory.
    This process runs all tasks if there is only one core, if the worker fails, or inside a worker process.
    Use it as a context manager, which ends the worker.

    Args:
        in_process: Whether to start no worker.
    """

    def __init__(self, *, in_process: bool = False) -> None:
        self._other: _Worker | None = None
        self._sent: Problem | None = None
        if not in_process and (os.cpu_count() or 1) > 1 and multiprocessing.parent_process() is None:
            self._other = _Worker.started()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_error: object) -> None:
        if self._other is not None:
            self._other.end()

    def map(self, work: Work, problem: Problem, tasks: Sequence[Task]) -> list[Any]:
        """Return `work(problem, *task)` for every task, in their order.

        Exceptions of the work are raised here: this process repeats work that fails in the worker.

        Args:
            work: A pure function of a module.
            problem: The problem that all tasks share. It is sent once as long as it is the same object.
            tasks: Further arguments of each call; they must be picklable.
        """
        submitted = self._submitted(work, problem, tasks[1:])
        own_tasks = tasks[: len(tasks) - len(submitted)]
        results: list[Any] = [work(problem, *task) for task in own_tasks]
        # from the end, for the worker starts at the front
        for future, task in zip(reversed(submitted), reversed(tasks[len(own_tasks) :]), strict=True):
            results.insert(len(own_tasks), work(problem, *task) if future.cancel() else future)
        return [_result(work, problem, *pair) for pair in zip(results, tasks, strict=True)]

    def _submitted(self, work: Work, problem: Problem, tasks: Sequence[Task]) -> list[Future[bytes]]:
        """Send tasks to the worker and return their futures; an empty list without a worker."""
        if self._other is None or not tasks:
            return []
        if self._sent is not problem:
            self._other.ask(pickle.dumps(problem))
            self._sent, _problems[:] = problem, [problem]
        return [self._other.ask(_packed((work, task))) for task in tasks]


def _result(work: Work, problem: Problem, result: Any, task: Task) -> Any:
    """Return the worker's result, computed in this process if the worker is gone or could not compute it."""
    if not isinstance(result, Future):
        return result
    answer = result.result()
    return work(problem, *task) if answer == _NOT_DONE else _unpacked(answer)


class _Worker:
    """The other process; a thread sends it one message at a time and waits for the answer."""

    def __init__(self, process: subprocess.Popen[bytes], connection: Connection) -> None:
        self._process, self._connection = process, connection
        self._asking = ThreadPoolExecutor(1, "worker")

    @classmethod
    def started(cls) -> Self | None:
        """Start the worker; return None if this computer does not allow it. Importing takes it a second."""
        if not sys.executable:  # Python within another program
            return None
        near_end, far_end = multiprocessing.Pipe()
        places = [place or os.getcwd() for place in sys.path]
        try:
            with far_end, blocked(signal.SIGINT):  # this process ends it
                process = subprocess.Popen(
                    [sys.executable, "-c", _START, str(far_end.fileno()), *places],
                    stdin=subprocess.DEVNULL,  # this one's may be the program that runs
                    pass_fds=[far_end.fileno()],
                )
        except OSError:
            near_end.close()
            return None
        return cls(process, near_end)

    def ask(self, message: bytes) -> Future[bytes]:
        """Send a message; the future's result is `_NOT_DONE` if the worker does not answer."""
        return self._asking.submit(self._answer, message)

    def _answer(self, message: bytes) -> bytes:
        try:
            self._connection.send_bytes(message)
            return self._connection.recv_bytes()
        except (OSError, EOFError):  # it was killed
            return _NOT_DONE

    def end(self) -> None:
        """Kill the worker, whatever it does."""
        self._process.kill()
        self._process.wait()
        self._asking.shutdown(cancel_futures=True)
        self._connection.close()


IN_PROCESS = WorkerPool(in_process=True)


def _packed(value: object) -> bytes:
    """Return a pickled value with the shared problem as a reference."""
    file = io.BytesIO()
    _Pickler(file, pickle.HIGHEST_PROTOCOL).dump(value)
    return file.getvalue()


def _unpacked(data: bytes) -> Any:
    return _Unpickler(io.BytesIO(data)).load()


def serve(descriptor: int) -> None:
    """Run as the worker: execute tasks from a connection until it closes.

    The connection closes when the other process ends for any reason. The worker then ends at once, even
    during a task.

    Args:
        descriptor: File descriptor of the inherited connection.
    """
    connection = Connection(descriptor)
    waiting: queue.SimpleQueue[bytes] = queue.SimpleQueue()

    def listen() -> None:
        try:
            while True:
                waiting.put(connection.recv_bytes())
        except (OSError, EOFError):
            os._exit(1)

    threading.Thread(target=listen, daemon=True).start()
    with suppress(OSError):
        while True:
            connection.send_bytes(_answered(waiting.get()))


def _answered(message: bytes) -> bytes:
    """Return the answer to a message: the packed result of a task, `_NOT_DONE` for the problem of the
    next tasks.
    """
    try:
        received = _unpacked(message)
        if isinstance(received, Problem):
            _problems[:] = [received]
            return _NOT_DONE
        work, task = received
        return _packed(work(_problems[0], *task))
    except Exception:  # noqa: BLE001 - a class may live in the program that this process does not import
        return _NOT_DONE
