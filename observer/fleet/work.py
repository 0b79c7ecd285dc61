"""A worker's batch of jobs: done one after another, with parts that are built once.

Each kernel steps one log at a time. The logs of a batch share the machine, its estimator and the loaded
kernels, which cost more than a short log does.
"""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import lru_cache
from pathlib import Path
from typing import Any

from observer import LogError, Machine, UserError, load
from observer.fleet.jobs import Job, Verb
from observer.fleet.journal import (
    WHY,
    GivenUpError,
    Row,
    RunOptions,
    begin,
    finish,
    finished_row,
    provenance,
    remove_attempts,
    remove_work_folder,
)

_TURN = threading.Lock()
"""One job at a time in a process, whatever its number of threads: figures and time limits belong to one job.
"""
_CACHED_MACHINES = 8
_EXIT = 70


def work(jobs: Sequence[Job], options: RunOptions) -> list[Row]:
    """Do a batch of jobs; return a row for each, with its problem in `problem`.

    Nothing that a job does is raised: a failed log has a row, and the others are done. A job beyond its time
    limit ends the whole process, since compiled code cannot be interrupted.

    A worker of a cluster outlives the command: jobs that remain after its end are dropped and have no row.
    """
    with _TURN:
        rows = [_one(job, options) for job in jobs if not options.has_ended]
        if options.has_ended:
            remove_work_folder(options)
        return rows


def failed(job: Job, options: RunOptions, problem: str) -> Row:
    """Return the row of a job that could not be done.

    Args:
        job: The job.
        options: The options of the run.
        problem: A sentence with the file and the remedy.
    """
    return _row(job, options, problem, 0.0, {})


def _row(job: Job, options: RunOptions, problem: str | None, seconds: float, result: dict[str, Any]) -> Row:
    """Return the row of a job in the fleet's results; `problem` is None for one that succeeded."""
    return {
        "machine": job.machine,
        "verb": options.verb,
        "name": job.name,
        "logs": [str(log) for log in job.logs],
        "config": str(job.config),
        "folder": str(job.folder),
        "problem": problem,
        "seconds": seconds,
        "found": result,
    }


def _one(job: Job, options: RunOptions) -> Row:
    """Do one job, or return its row if it is finished."""
    if (row := finished_row(job, options)) is not None:
        return row  # by a process that died later on in the same batch
    started_s = time.monotonic()
    try:
        part = begin(job, options)
        with _limited(job, options, part):
            made_of = _provenance(job, options)
            result = _VERBS[options.verb](job, options, part)
            row = _row(job, options, None, time.monotonic() - started_s, result)
            finish(part, job, options, made_of, row)
            return row
    except UserError as error:
        problem = str(error)
    except OSError as error:
        problem = f"{error.filename or job.logs[0]}: {error.strerror}; check that file"
    except Exception as error:  # noqa: BLE001 - whatever one log does, the others are to be finished
        problem = f"{job.logs[0]}: a defect of the program, {type(error).__name__}: {error}; please report it"
    remove_attempts(job, options)
    return failed(job, options, problem)


def _provenance(job: Job, options: RunOptions) -> dict[str, Any]:
    for log in job.logs:
        if not log.is_file():
            raise LogError(f"{log}: no such file; give the path of a log")
    if not job.config.is_file():
        raise GivenUpError(f"{job.config}: no such file; give the path of a configuration")
    return provenance(job, options)


@contextmanager
def _limited(job: Job, options: RunOptions, part: Path) -> Iterator[None]:
    """End this process if a job exceeds its time limit, since compiled code cannot be interrupted."""

    def give_up() -> None:
        why = (
            f"{job.logs[0]}: not done within {options.limit_s:g} s; try it alone, or with a longer --limit-s"
        )
        (part / WHY).write_text(why, encoding="utf-8")
        os._exit(_EXIT)

    timer = threading.Timer(options.limit_s, give_up)
    timer.daemon = True
    timer.start()
    try:
        yield
    finally:
        timer.cancel()


def _replay(job: Job, options: RunOptions, part: Path) -> dict[str, Any]:
    machine = _machine(job.config, job.config.read_bytes())
    estimates = machine.replay(job.logs[0])
    estimates.write(part, options.format, picture=False)
    good = estimates.summary["quality"]["good"] / max(1, estimates.summary["rows"])
    return _heats(machine, estimates.summary) | {"good": good}


def _identify(job: Job, options: RunOptions, part: Path) -> dict[str, Any]:
    machine = load(job.config)
    heats = machine.identify(job.logs[0], options.method)
    heats.write(part, options.format, picture=False)
    return _heats(machine, heats.summary)


def _calibrate(job: Job, _options: RunOptions, part: Path) -> dict[str, Any]:
    machine = load(job.config)
    result = machine.calibrate(job.logs)
    result.write(part)
    shown = ("calibrated", "not_told", "gap", "doubts")
    return _type_of(machine) | {key: result.document[key] for key in shown}


def _discover(job: Job, _options: RunOptions, part: Path) -> dict[str, Any]:
    machine = load(job.config)
    result = machine.discover(job.logs, alone=True).write(part)
    shown = ("verdict", "effects", "alternatives", "family", "calibrated", "gap", "doubts")
    return _type_of(machine) | {key: result[key] for key in shown}


_VERBS: dict[Verb, Callable[[Job, RunOptions, Path], dict[str, Any]]] = {
    "replay": _replay,
    "identify": _identify,
    "calibrate": _calibrate,
    "discover": _discover,
}


def _heats(machine: Machine, summary: Mapping[str, Any]) -> dict[str, Any]:
    shown = ("rows", "duration_s", "heat_mean_W", "speed_mean_rpm", "doubts")
    return _type_of(machine) | {key: summary[key] for key in shown}


def _type_of(machine: Machine) -> dict[str, Any]:
    """Return the key of comparable machines: the screw's size, and the names of its heat sources."""
    screw = machine.config.screw
    return {
        "type": f"{screw.length_m:g} m × {1000 * screw.diameter_m:g} mm",
        "sources": [source.name for source in machine.config.source],
    }


@lru_cache(maxsize=_CACHED_MACHINES)
def _machine(config: Path, _text: bytes) -> Machine:
    """Return the machine of a configuration, cached for later logs while its text is the same."""
    return load(config)
