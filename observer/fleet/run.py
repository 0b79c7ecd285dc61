"""Orders given to the processes of a Dask cluster, a bounded number at a time, and their rows gathered."""

# Dask tells nothing of its types.
# mypy: disable-error-code="no-untyped-call"

from __future__ import annotations

import logging
import os
import signal
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import replace
from importlib.metadata import version
from multiprocessing import resource_tracker
from pathlib import Path
from typing import Any

import dask
from distributed import Client, LocalCluster, Status, as_completed
from distributed.utils import LoopRunner

from observer.errors import UserError
from observer.fleet.batches import batches
from observer.fleet.journal import How, Row, alone_in, done
from observer.fleet.orders import Order
from observer.fleet.work import failed, work
from observer.signals import unheard

WAIT_S = 30.0
AHEAD = 2
"""Portions given out per thread: one that is worked on and one that waits for it."""
Progress = Callable[[int, int], None]


class EndedError(Exception):
    """Ctrl-C, or what counts as that, while work was done: `rows` of what is done, of `total` orders."""

    def __init__(self, rows: list[Row], total: int) -> None:
        """Take what is done."""
        super().__init__(f"{len(rows)} of {total} done")
        self.rows, self.total = rows, total


def run(
    orders: Sequence[Order],
    how: How,
    progress: Progress,
    *,
    workers: int,
    memory_GB: float | None = None,
    address: str | None = None,
) -> tuple[list[Row], int]:
    """Do what is not done yet; returns the rows of all orders, failed ones too, and how many were done.

    The workers are `workers` processes of this computer, each with at most `memory_GB`, or those of the
    cluster at `address`, which see logs and output under the same paths. Raises `UserError` where there is no
    cluster, and `EndedError` in place of `KeyboardInterrupt`.
    """
    with alone_in(how.output) as folder:
        how = replace(how, run=folder.name)
        found = {order: done(order, how) for order in orders}
        rows = [row for row in found.values() if row is not None]
        before, left = len(rows), [order for order, row in found.items() if row is None]
        progress(before, len(orders))
        if left:
            try:
                with _client(workers, memory_GB, address, folder) as client:
                    for some in _done_by(client, left, how):
                        rows += some
                        progress(len(rows), len(orders))
            except KeyboardInterrupt:
                raise EndedError(rows + _besides(rows, left, how), len(orders)) from None
    return rows, before


def _besides(rows: Sequence[Row], orders: Sequence[Order], how: How) -> list[Row]:
    """The rows of what is done in portions that have not come back."""
    told = {row["folder"] for row in rows}
    found = (done(order, how) for order in orders if str(order.place) not in told)
    return [row for row in found if row is not None]


def _done_by(client: Client, orders: Sequence[Order], how: How) -> Iterator[list[Row]]:
    """Yield the rows of portions as they end; as many are given out as the workers need to stay busy."""
    threads = sum(client.nthreads().values())
    waiting = deque(batches(orders, threads))
    given: dict[Any, tuple[Order, ...]] = {}
    ending: Any = as_completed(raise_errors=False)

    def give() -> None:
        while waiting and len(given) < AHEAD * threads:
            portion = waiting.popleft()
            future = client.submit(work, portion, how, pure=False)
            given[future] = portion
            ending.add(future)

    give()
    for future in ending:
        portion = given.pop(future)
        if future.status == "finished":
            yield future.result()
        elif client.status != "running" or future.status in ("cancelled", "lost"):
            raise UserError(
                "fleet: the cluster has gone; start it and give the same command again, which goes on here"
            )
        elif len(portion) > 1:  # a worker died of one of them, perhaps; each for itself, then
            waiting.extendleft((order,) for order in portion)
        else:
            yield [failed(portion[0], how, _why(portion[0], future))]
        future.release()
        give()


def _why(order: Order, future: Any) -> str:
    return (
        f"{order.logs[0]}: its worker did not come back ({type(future.exception()).__name__}); try it alone"
    )


@contextmanager
def _client(workers: int, memory_GB: float | None, address: str | None, folder: Path) -> Iterator[Client]:
    """A client of the cluster at an address, or of one of our own for as long as it is needed."""
    if address is not None:
        with _joined(address) as client:
            yield client
        return
    settings = {
        "distributed.worker.daemon": True,
        "temporary-directory": str(folder),
        # Dask holds nothing but rows here: a worker that waits until memory is free would wait for ever
        **{f"distributed.worker.memory.{what}": False for what in ("target", "spill", "pause")},
    }
    with ExitStack() as stack:
        stack.enter_context(dask.config.set(settings))
        runner = _deaf_to_ctrl_c()
        stack.callback(runner.stop)
        with unheard(signal.SIGINT, signal.SIGTERM):  # half a cluster cannot be ended in good order
            cluster = stack.enter_context(_cluster(runner, workers, memory_GB, folder))
        client = stack.enter_context(Client(cluster))
        try:
            yield client
        except KeyboardInterrupt:
            _kill(cluster)
            raise


def _cluster(runner: LoopRunner, workers: int, memory_GB: float | None, folder: Path) -> LocalCluster:
    return LocalCluster(
        loop=runner.loop,
        n_workers=workers,
        threads_per_worker=1,
        processes=True,
        host="127.0.0.1",
        dashboard_address="127.0.0.1:0",  # None would be port 8787, on all interfaces
        scheduler_kwargs={"dashboard": False},
        local_directory=str(folder),
        memory_limit="auto" if memory_GB is None else int(memory_GB * 1e9),
        silence_logs=logging.CRITICAL,
    )


def _deaf_to_ctrl_c() -> LoopRunner:
    """Start the thread that starts the workers so that Ctrl-C, which a terminal sends to all, is not theirs.

    The deaf hand it on to their processes; a worker that hears it while it starts prints a traceback.
    """
    resource_tracker.ensure_running()  # it would give its starter ears again
    for name in ("asyncio", "distributed"):  # of workers that are ended while they start, and what follows
        logging.getLogger(name).setLevel(logging.CRITICAL)
    runner = LoopRunner()
    with unheard(signal.SIGINT):
        runner.start()
    return runner


def _kill(cluster: LocalCluster) -> None:
    """End the workers now: asked to, each would first finish its log, or be waited for in vain."""
    for nanny in cluster.workers.values():
        nanny.status = Status.closing_gracefully  # it closes with its process, and starts no other
        with suppress(OSError, TypeError):
            os.kill(nanny.pid, signal.SIGKILL)


@contextmanager
def _joined(address: str) -> Iterator[Client]:
    try:
        client = Client(address, timeout=WAIT_S)
    except (OSError, ValueError, TypeError):
        raise UserError(
            f"--scheduler: no Dask scheduler answers at {address}; give the address that "
            "`dask scheduler` prints"
        ) from None
    with client:
        try:
            client.wait_for_workers(1, timeout=WAIT_S)
        except TimeoutError:
            raise UserError(
                f"--scheduler: {address} has no worker; start some with `dask worker {address}`"
            ) from None
        _agree(client, address)
        yield client


def _agree(client: Client, address: str) -> None:
    """Refuse workers that do not have this version of the program."""
    here = version("ballscrew-observer")
    told = client.run(_version, on_error="return")
    for worker, there in told.items():
        if there != here:
            said = there if isinstance(there, str) else f"none ({type(there).__name__})"
            raise UserError(
                f"--scheduler: the worker {worker} of {address} has ballscrew-observer {said}, and "
                f"this is {here}; install the same there"
            )


def _version() -> str:
    import observer.fleet.work  # noqa: F401 - it can be had there

    return version("ballscrew-observer")
