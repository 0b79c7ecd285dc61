"""Distributes jobs to the processes of a Dask cluster, and gathers their rows."""

# Dask has no type annotations.
# mypy: disable-error-code="no-untyped-call"

from __future__ import annotations

import logging
import math
import os
import signal
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import replace
from importlib.metadata import version
from multiprocessing import resource_tracker
from pathlib import Path

import dask
from distributed import Client, LocalCluster, Status, as_completed
from distributed.utils import LoopRunner

from observer.errors import UserError
from observer.fleet.jobs import Job
from observer.fleet.journal import TRIES, Row, RunOptions, exclusive, finished_row
from observer.fleet.work import failed, work
from observer.process.signals import blocked

WAIT_S = 30.0
MOST_JOBS = 8
BATCHES_PER_WORKER = 4
"""Minimum batches per worker, so that the last batch delays the end by at most a quarter."""
Progress = Callable[[int, int], None]


def run(
    jobs: Sequence[Job],
    options: RunOptions,
    progress: Progress,
    *,
    workers: int,
    memory_GB: float | None = None,
    address: str | None = None,
) -> tuple[list[Row], int]:
    """Do the unfinished jobs.

    A job whose worker dies is tried a second time. Ctrl-C ends the workers of this computer; finished jobs
    stay, and the same command continues after them.

    Args:
        jobs: All jobs, finished ones too.
        options: The options of the run.
        progress: Called in this thread with the numbers of finished and of all jobs.
        workers: Processes on this computer, if there is no `address`.
        memory_GB: The limit of each process; None shares the computer's memory.
        address: The address of a Dask scheduler; its workers must see logs and output under the same paths.

    Returns:
        The rows of all jobs, failed ones too, and how many were done before.

    Raises:
        UserError: If the cluster cannot be reached, has no worker or another version, or is lost; or if the
            output is in use or cannot be written.
    """
    with exclusive(options.output) as folder:
        options = replace(options, run=folder.name)
        finished = {job: finished_row(job, options) for job in jobs}
        rows = [row for row in finished.values() if row is not None]
        before, left = len(rows), [job for job, row in finished.items() if row is None]
        progress(before, len(jobs))
        if left:
            with _client(workers, memory_GB, address, folder) as client:
                for new_rows in _results(client, left, options):
                    rows += new_rows
                    progress(len(rows), len(jobs))
    return rows, before


def batches(jobs: Sequence[Job], workers: int) -> list[tuple[Job, ...]]:
    """Group a few jobs of the same configuration, so that parts built for one log serve the next.

    A job on all logs of a machine is a batch of its own. Each worker gets several batches, and a batch has at
    most `MOST_JOBS` jobs.
    """
    batch_size = min(MOST_JOBS, max(1, math.ceil(len(jobs) / (BATCHES_PER_WORKER * workers))))
    by_config: dict[Path, list[Job]] = {}
    for job in jobs:
        by_config.setdefault(job.config, []).append(job)
    batches_of_jobs: list[tuple[Job, ...]] = []
    for same_config in by_config.values():
        size = 1 if len(same_config[0].logs) > 1 else batch_size
        batches_of_jobs += [
            tuple(same_config[start : start + size]) for start in range(0, len(same_config), size)
        ]
    return batches_of_jobs


def _results(client: Client, jobs: Sequence[Job], options: RunOptions) -> Iterator[list[Row]]:
    """Yield the rows of batches as they end.

    If a worker dies, Dask gives its batch to another, which skips the finished jobs. A job that has ended its
    worker twice is given up (`journal.begin`).
    """
    threads = sum(client.nthreads().values())
    batch_of = {client.submit(work, batch, options, pure=False): batch for batch in batches(jobs, threads)}
    for future in as_completed(list(batch_of), raise_errors=False):
        batch = batch_of.pop(future)
        if future.status == "finished":
            yield future.result()
        elif client.status != "running" or future.status in ("cancelled", "lost"):
            raise UserError(
                "fleet: the cluster is gone; start it and give the same command again, which continues here"
            )
        else:
            cause = type(future.exception()).__name__
            problem = f"its worker did not come back ({cause}); try it alone"
            yield [
                finished_row(job, options) or failed(job, options, f"{job.logs[0]}: {problem}")
                for job in batch
            ]
        future.release()


@contextmanager
def _client(workers: int, memory_GB: float | None, address: str | None, folder: Path) -> Iterator[Client]:
    """Hold a client of the cluster at an address, or of a temporary cluster on this computer."""
    if address is not None:
        with _existing(address) as client:
            yield client
        return
    settings = {
        "distributed.worker.daemon": True,
        "distributed.scheduler.allowed-failures": TRIES * MOST_JOBS,
        "temporary-directory": str(folder),
        # Dask holds nothing but rows here: a worker that waits until memory is free would wait for ever
        **{f"distributed.worker.memory.{threshold}": False for threshold in ("target", "spill", "pause")},
    }
    with ExitStack() as stack:
        stack.enter_context(dask.config.set(settings))
        runner = _blocking_ctrl_c()
        stack.callback(runner.stop)
        with blocked(signal.SIGINT, signal.SIGTERM):  # half a cluster cannot be shut down cleanly
            cluster = stack.enter_context(_cluster(runner, workers, memory_GB, folder))
        client = stack.enter_context(Client(cluster))
        try:
            yield client
        except KeyboardInterrupt:
            _kill(cluster)
            raise


def _cluster(runner: LoopRunner, workers: int, memory_GB: float | None, folder: Path) -> LocalCluster:
    """Return a cluster of `workers` processes on this computer, reachable from no other.

    `memory_GB` limits each process, None leaves the limit to Dask; temporary files are in `folder`.
    """
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


def _blocking_ctrl_c() -> LoopRunner:
    """Start the thread that starts the workers with SIGINT blocked, since a terminal sends Ctrl-C to all of
    them.

    Their processes inherit this; a worker that is interrupted while it starts prints a traceback.
    """
    resource_tracker.ensure_running()  # it would unblock the signal again
    for name in ("asyncio", "distributed"):  # of workers that are ended while they start, and what follows
        logging.getLogger(name).setLevel(logging.CRITICAL)
    runner = LoopRunner()
    with blocked(signal.SIGINT):
        runner.start()
    return runner


def _kill(cluster: LocalCluster) -> None:
    """Kill the workers, since each would finish its log before a normal end."""
    for nanny in cluster.workers.values():
        nanny.status = Status.closing_gracefully  # it closes with its process, and starts no other
        with suppress(OSError, TypeError):
            os.kill(nanny.pid, signal.SIGKILL)


@contextmanager
def _existing(address: str) -> Iterator[Client]:
    """Yield a client of a running scheduler.

    Raises `UserError` where none answers, it has no worker within `WAIT_S`, or its versions differ.
    """
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
        _check_versions(client, address)
        yield client


def _check_versions(client: Client, address: str) -> None:
    """Reject workers with another version of the program. Raises `UserError`."""
    own_version = version("ballscrew-observer")
    for worker, worker_version in client.run(_version, on_error="return").items():
        if worker_version != own_version:
            shown_version = (
                worker_version
                if isinstance(worker_version, str)
                else f"none ({type(worker_version).__name__})"
            )
            raise UserError(
                f"--scheduler: the worker {worker} of {address} has ballscrew-observer {shown_version}, and "
                f"this is {own_version}; install the same there"
            )


def _version() -> str:
    import observer.fleet.work  # noqa: F401 - it can be imported there

    return version("ballscrew-observer")
