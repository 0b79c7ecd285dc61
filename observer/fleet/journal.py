"""Finished jobs: each has a folder with its results and a record of its inputs, moved into place as a whole.

The folders alone decide which jobs are finished; a separate list could disagree with the files.
"""

from __future__ import annotations

import fcntl
import hashlib
import json
import secrets
import shutil
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any

from observer.errors import UserError
from observer.files.documents import write_json
from observer.fleet.jobs import Job, Verb
from observer.history.history import Method

DONE_FILE = "done.json"
WORK = ".work"
WHY = "why"
ALIVE = "alive"
"""A file in the folder of a run: a worker whose folder was removed recreates it."""
TRIES = 2

Row = dict[str, Any]


@dataclass(frozen=True, slots=True)
class RunOptions:
    """The options of a run.

    Attributes:
        verb: What is done with each job.
        output: The folder for results.
        format: `parquet` or `csv`, for tables of estimates and heats.
        method: The method of `identify`.
        limit_s: The time limit of a job, in s.
        run: The name of the run's folder below `.work`, which is removed when the run ends; empty without a
            run.
    """

    verb: Verb
    output: Path
    format: str = "parquet"
    method: Method = "smoother"
    limit_s: float = 3600.0
    run: str = ""
    """The name of the run's folder below `.work`, which is removed when the run ends."""

    @property
    def work(self) -> Path:
        """The working folder of the run."""
        return self.output / WORK / self.run

    @property
    def has_ended(self) -> bool:
        """Whether the run that issued the job is over, so that no process waits for it."""
        return bool(self.run) and not (self.work / ALIVE).exists()

    @property
    def of_results(self) -> dict[str, str]:
        """The options on which the results depend, with the program's version.

        Results are made again if one of these differs.
        """
        chosen = {"verb": self.verb, "version": version("ballscrew-observer")}
        if self.verb in ("replay", "identify"):
            chosen["format"] = self.format
        if self.verb == "identify":
            chosen["method"] = self.method
        return chosen


class GivenUpError(UserError):
    """A job that will not be retried.

    Its text names the log, the reason and the remedy, and becomes the row's problem.
    """


def provenance(job: Job, options: RunOptions) -> dict[str, Any]:
    """Return all that results depend on: options, and digests of the configuration and of each log.

    Call it before the job reads its inputs, so that a later change is noticed.

    Raises:
        OSError: If a file does not exist or cannot be read.
    """
    return {
        **options.of_results,
        "config_sha256": _digest(job.config),
        "logs": [{"path": str(log), **_look(log), "sha256": _digest(log)} for log in job.logs],
    }


def finished_row(job: Job, options: RunOptions) -> Row | None:
    """Return the row of a finished job.

    A log counts as unchanged by its size and time of change. If the time differs, its digest decides.

    Args:
        job: The job, with its logs and configuration.
        options: The present options; other options make the results invalid.

    Returns:
        The recorded row; None if the job is not finished, or if options or inputs have changed since.
    """
    try:
        document = json.loads((options.output / job.folder / DONE_FILE).read_text(encoding="utf-8"))
        made_of, row = document["made_of"], document["row"]
        same = (
            made_of["config_sha256"] == _digest(job.config)
            and made_of.items() >= options.of_results.items()
            and [entry["path"] for entry in made_of["logs"]] == [str(log) for log in job.logs]
            and all(_is_same(log, entry) for log, entry in zip(job.logs, made_of["logs"], strict=True))
        )
        return dict(row) if same else None
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        return None


def _look(log: Path) -> dict[str, int]:
    status = log.stat()
    return {"bytes": status.st_size, "mtime_ns": status.st_mtime_ns}


def _is_same(log: Path, entry: Mapping[str, Any]) -> bool:
    """Whether a log is unchanged: by size and time, or, if it was copied, by its text."""
    now = _look(log)
    if now["bytes"] != entry["bytes"]:
        return False
    return bool(now["mtime_ns"] == entry["mtime_ns"] or _digest(log) == entry["sha256"])


def _digest(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def begin(job: Job, options: RunOptions) -> Path:
    """Make the working folder of a job, and return it.

    Folders of earlier tries remain if their process died, so the number of folders is the number of tries.

    Args:
        job: The job.
        options: The options, whose working folder exists.

    Raises:
        GivenUpError: If the time limit was exceeded, or if two tries have ended with their process.
    """
    for number in range(1, TRIES + 1):
        part = options.work / f"{_base(job)}.{number}"
        if not part.exists():
            part.mkdir(parents=True)
            return part
        with suppress(OSError):
            raise GivenUpError((part / WHY).read_text(encoding="utf-8"))
    raise GivenUpError(
        f"{job.logs[0]}: the process that worked on it has died {TRIES} times, perhaps for lack of memory; "
        "try it alone, with a larger --memory-GB, or shorten it"
    )


def _base(job: Job) -> str:
    """Return the common prefix of the folders of all tries of a job."""
    return hashlib.sha256(str(job.folder).encode()).hexdigest()[:24]


def finish(part: Path, job: Job, options: RunOptions, made_of: Mapping[str, Any], row: Row) -> None:
    """Move the results to their folder, with the record of their inputs.

    The move is one rename, so a folder of results is always complete. Older results are removed.

    Args:
        part: The working folder with the results.
        job: The job.
        options: The options of the run.
        made_of: What `provenance` returned before the job began.
        row: The job's row.

    Raises:
        OSError: If the folder cannot be written, as on a full disk.
    """
    write_json(part / DONE_FILE, {"made_of": made_of, "row": row})
    folder = options.output / job.folder
    folder.parent.mkdir(parents=True, exist_ok=True)
    old = part.with_name(f"{part.name}.old")
    if folder.exists():
        folder.rename(old)
    part.rename(folder)
    remove_attempts(job, options)


def remove_attempts(job: Job, options: RunOptions) -> None:
    """Remove the working folders of all tries of a job.

    Files that cannot be removed stay, and the next run removes them.
    """
    for part in options.work.glob(f"{_base(job)}.*"):
        shutil.rmtree(part, ignore_errors=True)


def remove_work_folder(options: RunOptions) -> None:
    """Remove files that a worker made after the end of its run.

    A worker of a cluster may outlive its run and write into a folder that is already gone.
    """
    shutil.rmtree(options.work, ignore_errors=True)
    with suppress(OSError):  # another run is at work
        (options.output / WORK).rmdir()


@contextmanager
def exclusive(output: Path) -> Iterator[Path]:
    """Lock a folder of results for this run; yield its empty working folder, which is removed at the end.

    The lock is a file lock, which ends with the process. Leftovers of a killed run are removed at the start.

    Raises:
        UserError: If another run is using the folder, or if it cannot be written.
    """
    work = output / WORK
    try:
        output.mkdir(parents=True, exist_ok=True)
        with (output / ".lock").open("w") as lock:
            try:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
                if not (output / ".lock").exists():  # removed by a run that ended at this moment
                    raise BlockingIOError
            except BlockingIOError:
                raise UserError(
                    f"{output}: another run is working there; wait for it, or give another folder"
                ) from None
            try:
                shutil.rmtree(work, ignore_errors=True)  # left by a run that was killed
                folder = work / secrets.token_hex(4)
                folder.mkdir(parents=True)
                (folder / ALIVE).touch()
                yield folder
            finally:
                shutil.rmtree(work, ignore_errors=True)
                (output / ".lock").unlink(missing_ok=True)
    except OSError as error:
        raise UserError(
            f"{output}: results cannot be written there ({error.strerror}); name a folder that can be "
            "written, or free space"
        ) from None


def rows_in(output: Path) -> Iterator[Row]:
    """Yield the rows of all finished jobs in a folder of results, of any verb.

    A record that cannot be read is skipped, and its job is done again by the next run.
    """
    for file in sorted(output.glob(f"*/*/{DONE_FILE}")) + sorted(output.glob(f"*/*/*/{DONE_FILE}")):
        with suppress(OSError, ValueError, KeyError, TypeError):
            yield dict(json.loads(file.read_text(encoding="utf-8"))["row"])
