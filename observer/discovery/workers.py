"""A worker process that fits hypotheses beside this one; threads would share one interpreter lock."""

from __future__ import annotations

import copyreg
import io
import multiprocessing
import os
import pickle
import signal
import threading
from collections.abc import Callable, Sequence
from concurrent.futures import Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from typing import Any, Self

from observer.fit.problem import Problem
from observer.signals import blocked

Work = Callable[..., Any]
Task = tuple[Any, ...]
_problems: list[Problem] = []
"""The problem that all tasks share: the worker gets it once, tasks and results only refer to it."""


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
                self._other.submit(_take, pickle.dumps([]))  # importing takes a second

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, *_error: object) -> None:
        if self._other is not None:
            if kind is not None:  # nobody needs its results
                for process in multiprocessing.active_children():
                    process.kill()
            self._other.shutdown(wait=kind is not None, cancel_futures=True)

    def each(self, work: Work, problem: Problem, tasks: Sequence[Task]) -> list[Any]:
        """Return `work(problem, *task)` for every task; the work is a pure, module-level function."""
        later = self._submitted(work, problem, tasks[1:])
        here = tasks[: len(tasks) - len(later)]
        done: list[Any] = [work(problem, *task) for task in here]
        # from the end, for the worker starts at the front
        for future, task in zip(reversed(later), reversed(tasks[len(here) :]), strict=True):
            done.insert(len(here), work(problem, *task) if future.cancel() else future)
        return [self._result(work, problem, *pair) for pair in zip(done, tasks, strict=True)]

    def _submitted(self, work: Work, problem: Problem, tasks: Sequence[Task]) -> list[Future[bytes]]:
        """What the worker may do; nothing where there is none."""
        if self._other is None or not tasks:
            return []
        try:
            if self._sent is not problem:
                self._other.submit(_take, pickle.dumps([problem]))
                self._sent, _problems[:] = problem, [problem]
            return [self._other.submit(_do, _packed((work, task), problem)) for task in tasks]
        except BrokenProcessPool:
            self._other = None
            return []

    def _result(self, work: Work, problem: Problem, done: Any, task: Task) -> Any:
        """The worker's result, computed here if the worker is gone."""
        if not isinstance(done, Future):
            return done
        try:
            return pickle.loads(done.result())
        except BrokenProcessPool:
            self._other = None
            return work(problem, *task)


IN_PROCESS = WorkerPool(alone=True)


def _packed(value: object, problem: Problem) -> bytes:
    """Pickle a value with the shared problem as a reference."""

    def reduced(one: Problem) -> Any:
        return (_shared, ()) if one is problem else one.__reduce_ex__(pickle.HIGHEST_PROTOCOL)

    file = io.BytesIO()
    packer = pickle.Pickler(file, pickle.HIGHEST_PROTOCOL)
    packer.dispatch_table = copyreg.dispatch_table | {Problem: reduced}
    packer.dump(value)
    return file.getvalue()


def _shared() -> Problem:
    return _problems[0]


def _end_with_parent() -> None:
    """In the worker: exit when the parent has, however it ended."""
    parent = multiprocessing.parent_process()
    assert parent is not None

    def wait() -> None:
        parent.join()
        os._exit(1)

    threading.Thread(target=wait, daemon=True).start()


def _take(data: bytes) -> None:
    """In the worker: keep the problem of the tasks that follow."""
    _problems[:] = pickle.loads(data)


def _do(data: bytes) -> bytes:
    """In the worker: run a task."""
    work, task = pickle.loads(data)
    return _packed(work(_shared(), *task), _shared())
