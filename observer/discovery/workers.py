"""A second process that fits hypotheses beside this one: threads would wait for each other's interpreter."""

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
"""In the second process: the problem that was sent last."""


class Crew:
    """Does pieces of work on one problem, each in this process or the other; which, the results do not tell.

    Without a second core, where a second process cannot be had, or in a process that itself works for
    another, this one does all.
    """

    def __init__(self, *, alone: bool = False) -> None:
        self._other: ProcessPoolExecutor | None = None
        self._sent: Problem | None = None
        if not alone and (os.cpu_count() or 1) > 1 and multiprocessing.parent_process() is None:
            self._other = ProcessPoolExecutor(
                1, mp_context=multiprocessing.get_context("spawn"), initializer=_end_with_parent
            )
            with blocked(signal.SIGINT):  # who has started it ends it
                self._other.submit(_awake)  # it takes a second

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._other is not None:
            if error is not None:  # nobody waits for what it does
                for process in multiprocessing.active_children():
                    process.kill()
            self._other.shutdown(wait=error is not None, cancel_futures=True)

    def each(self, work: Work, problem: Problem, tasks: Sequence[Task]) -> list[Any]:
        """Return `work(problem, *task)` of every task; the work is a pure function of a module."""
        later = [self._submit(work, problem, task) for task in tasks[1:]]
        done: list[Any] = [work(problem, *task) for task in tasks[:1]]
        # from behind, for the other begins in front
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
        """What the other process found; worked out here where it has gone."""
        try:
            return _unpacked(future.result(), problem)
        except BrokenProcessPool:
            self._other = None
            return work(problem, *task)


ALONE = Crew(alone=True)


class _Packer(pickle.Pickler):
    """Writes the problem that all tasks share as a mark."""

    problem: Problem

    def persistent_id(self, obj: Any) -> str | None:
        """Mark the problem."""
        return "problem" if obj is self.problem else None


class _Unpacker(pickle.Unpickler):
    """Puts this process' own problem where the mark is."""

    problem: Problem

    def persistent_load(self, pid: Any) -> Problem:  # noqa: ARG002 - there is only one mark
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
    """In the second process: end when the first has, however it was ended."""
    parent = multiprocessing.parent_process()
    assert parent is not None

    def wait() -> None:
        parent.join()
        os._exit(1)

    threading.Thread(target=wait, daemon=True).start()


def _awake() -> None:
    """Nothing: to be asked imports what a fit needs."""


def _take(data: bytes) -> None:
    """In the second process: keep the problem of what follows."""
    _problems[:] = [pickle.loads(data)]


def _do(data: bytes) -> bytes:
    """In the second process: do a piece of work."""
    [problem] = _problems
    work, task = _unpacked(data, problem)
    return _packed(work(problem, *task), problem)
