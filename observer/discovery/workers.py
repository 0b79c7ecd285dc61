"""A worker process that fits hypotheses beside this one; threads would share one interpreter lock."""

from __future__ import annotations

import io
import multiprocessing
import os
import pickle
import signal
import threading
from collections.abc import Callable, Sequence
from concurrent.futures import Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from types import TracebackType
from typing import Any, Self

from observer.fit.problem import Problem
from observer.signals import blocked

Work = Callable[..., Any]
Task = tuple[Any, ...]
_problems: list[Problem] = []
"""In the worker: the problem that was sent last."""


class WorkerPool:
    """Runs tasks on one problem in this process and one worker, with the same results as this process alone.

    Without a second core, if the worker fails, or inside a worker process, this process runs all tasks.
    """

    def __init__(self, *, alone: bool = False) -> None:
        self._other: ProcessPoolExecutor | None = None
        self._sent: Problem | None = None
        if not alone and (os.cpu_count() or 1) > 1 and multiprocessing.parent_process() is None:
            self._other = ProcessPoolExecutor(
                1, mp_context=multiprocessing.get_context("spawn"), initializer=_end_with_parent
            )
            with blocked(signal.SIGINT):  # this process ends it
                self._other.submit(_awake)  # importing takes a second

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._other is not None:
            if error is not None:  # nobody needs its results
                for process in multiprocessing.active_children():
                    process.kill()
            self._other.shutdown(wait=error is not None, cancel_futures=True)

    def each(self, work: Work, problem: Problem, tasks: Sequence[Task]) -> list[Any]:
        """Return `work(problem, *task)` for every task; the work is a pure, module-level function."""
        later = [self._submit(work, problem, task) for task in tasks[1:]]
        done: list[Any] = [work(problem, *task) for task in tasks[:1]]
        # from the end, for the worker starts at the front
        for future, task in zip(reversed(later), reversed(tasks[1:]), strict=True):
            done.insert(1, None if future and not future.cancel() else work(problem, *task))
        for i, future in enumerate(later, start=1):
            if future is not None and not future.cancelled():
                done[i] = self._result(future, work, problem, tasks[i])
        return done

    def _submit(self, work: Work, problem: Problem, task: Task) -> Future[bytes] | None:
        if self._other is None:
            return None
        try:
            if self._sent is not problem:
                self._other.submit(_take, pickle.dumps(problem))
                self._sent = problem
            return self._other.submit(_do, _packed((work, task), problem))
        except BrokenProcessPool:
            self._other = None
            return None

    def _result(self, future: Future[bytes], work: Work, problem: Problem, task: Task) -> Any:
        """The worker's result, computed here if the worker is gone."""
        try:
            return _unpacked(future.result(), problem)
        except BrokenProcessPool:
            self._other = None
            return work(problem, *task)


IN_PROCESS = WorkerPool(alone=True)


class _Packer(pickle.Pickler):
    """Pickles the problem that all tasks share as a reference."""

    problem: Problem

    def persistent_id(self, obj: Any) -> str | None:
        """Replace the problem by a reference."""
        return "problem" if obj is self.problem else None


class _Unpacker(pickle.Unpickler):
    """Resolves the reference to this process's own problem."""

    problem: Problem

    def persistent_load(self, pid: Any) -> Problem:  # noqa: ARG002 - there is only one reference
        """Return the problem."""
        return self.problem


def _packed(value: object, problem: Problem) -> bytes:
    file = io.BytesIO()
    packer = _Packer(file, pickle.HIGHEST_PROTOCOL)
    packer.problem = problem
    packer.dump(value)
    return file.getvalue()


def _unpacked(data: bytes, problem: Problem) -> Any:
    unpacker = _Unpacker(io.BytesIO(data))
    unpacker.problem = problem
    return unpacker.load()


def _end_with_parent() -> None:
    """In the worker: exit when the parent has, however it ended."""
    parent = multiprocessing.parent_process()
    assert parent is not None

    def wait() -> None:
        parent.join()
        os._exit(1)

    threading.Thread(target=wait, daemon=True).start()


def _awake() -> None:
    """Do nothing; unpickling the call imports what a fit needs."""


def _take(data: bytes) -> None:
    """In the worker: keep the problem of the tasks that follow."""
    _problems[:] = [pickle.loads(data)]


def _do(data: bytes) -> bytes:
    """In the worker: run a task."""
    [problem] = _problems
    work, task = _unpacked(data, problem)
    return _packed(work(problem, *task), problem)
