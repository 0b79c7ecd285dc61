"""`observer fleet …`: the verbs for logs, for a whole fleet."""

from __future__ import annotations

import os
import signal
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal, NamedTuple

import typer

from observer.cli.options import flattened, with_parameters
from observer.cli.output import counting, warn
from observer.errors import UserError
from observer.process.terminal import echo

if TYPE_CHECKING:
    from observer.fleet.jobs import Job
    from observer.fleet.journal import RunOptions

fleet = typer.Typer(
    help="Logs of many machines at once, on all cores or a Dask cluster; resumes where it was stopped.",
    no_args_is_help=True,
)

LogsArgument = Annotated[
    list[Path] | None, typer.Argument(metavar="LOGS...", help="Logs, with --config for all of them.")
]
TableOption = Annotated[
    Path | None, typer.Option(help="Instead of logs, a table (.csv, .parquet): log, machine, config.")
]
ConfigOption = Annotated[
    Path | None, typer.Option("--config", "-c", help="Configuration of all logs, which are of its machine.")
]
OutputOption = Annotated[
    Path, typer.Option("--output", "-o", help="Folder for the results; logs finished there are skipped.")
]
LimitOption = Annotated[float, typer.Option(min=1.0, help="Seconds after which a job is given up.")]
Verb = Literal["replay", "identify", "calibrate", "discover"]
MOST_SHOWN = 20


class Computers(NamedTuple):
    """Options that say where the work is done."""

    scheduler: Annotated[
        str | None,
        typer.Option(help="Address of a Dask cluster; default: one is started on this computer."),
    ] = None
    workers: Annotated[
        int | None,
        typer.Option(min=1, max=1024, help="Processes to start here; default: one per core."),
    ] = None
    memory: Annotated[
        float | None,
        typer.Option(
            "--memory-GB",
            min=0.5,
            help="Memory in GB for each process; one that needs more is stopped. Default: its share.",
        ),
    ] = None


class ResultChoices(NamedTuple):
    """Options that say what is written, and how it is found."""

    format: Annotated[Literal["csv", "parquet"], typer.Option(help="Format of the estimates.")] = "parquet"
    method: Annotated[
        Literal["smoother", "tikhonov", "conjugate-gradient"],
        typer.Option(metavar="METHOD", help="Method: smoother, tikhonov or conjugate-gradient."),
    ] = "smoother"


_VERBS: dict[Verb, tuple[str, float, tuple[str, ...]]] = {
    "replay": (
        "Replay every log: estimates and summary.json of each, and one report of all.",
        600.0,
        ("method",),
    ),
    "identify": (
        "Find the heats of each log from all its measurements at once: heats and summary.json of each, "
        "and one report of all.",
        3600.0,
        (),
    ),
    "calibrate": (
        "Fit every machine to all of its logs: config.toml and calibration.json of each, one report of all.",
        3600.0,
        ("format", "method"),
    ),
    "discover": (
        "Find the physics that each machine's model lacks, from all of its logs; one report of all.",
        7200.0,
        ("format", "method"),
    ),
}
"""What each verb does, its time limit in s, and the options that it does not have."""


def _command(verb: Verb, longest_s: float, without: Sequence[str]) -> Callable[..., None]:
    """The command of a verb."""

    def command(
        output: OutputOption,
        logs: LogsArgument = None,
        table: TableOption = None,
        config: ConfigOption = None,
        *,
        computers: Computers,
        limit_s: LimitOption = longest_s,
        results: ResultChoices,
    ) -> None:
        if (table is None) == (not logs) or (config is None) == (table is None):
            raise UserError(
                f"fleet {verb}: name either logs with --config for all of them, or a --table alone"
            )
        with _ended_by_signals(verb):
            from observer.fleet.jobs import jobs_of, read_table, rows_of_logs
            from observer.fleet.journal import RunOptions

            rows = read_table(table) if table is not None else rows_of_logs(logs or [], config or Path())
            options = RunOptions(verb, Path(os.path.abspath(output)), *results, limit_s)
            _run(jobs_of(rows, verb), options, output, computers)

    return with_parameters(flattened(command), without=without)


for _verb, (_help, _longest_s, _without) in _VERBS.items():
    fleet.command(_verb, help=_help)(_command(_verb, _longest_s, _without))


def _run(
    jobs: list[Job],
    options: RunOptions,
    output: Path,
    computers: Computers,
) -> None:
    """Do the work and print the outcome; `output` is the folder as given."""
    from observer.fleet.jobs import OF_SEVERAL
    from observer.fleet.journal import finished_row
    from observer.fleet.report import conclude
    from observer.fleet.run import run

    try:
        with counting(f"fleet {options.verb}", "logs done", "report") as progress:
            rows, before = run(
                jobs,
                options,
                progress,
                workers=computers.workers or os.cpu_count() or 1,
                memory_GB=computers.memory,
                address=computers.scheduler,
            )
    except KeyboardInterrupt:
        rows = [row for job in jobs if (row := finished_row(job, options)) is not None]
        conclude(options.output, rows)
        raise KeyboardInterrupt(f"ended with {len(rows)} of {len(jobs)} done") from None
    failures = conclude(options.output, rows)
    resumed = f", {before} of them before" if before else ""
    echo(f"{len(rows) - len(failures)} done{resumed}, {len(failures)} could not be done")
    warn([row["problem"] for row in failures[:MOST_SHOWN]])
    if len(failures) > MOST_SHOWN:
        warn([f"… and {len(failures) - MOST_SHOWN} more, in results.parquet"])
    per_folder = "each machine" if options.verb in OF_SEVERAL else "each log"
    echo(f"written to {output}: {per_folder} in its folder, results.parquet, report.html")
    if failures:
        raise typer.Exit(2 if len(failures) == len(rows) else 1)


@contextmanager
def _ended_by_signals(verb: Verb) -> Iterator[None]:
    """End in good order on Ctrl-C or SIGTERM, with the shell's exit code; on a second one, at once."""
    from observer.process.shutdown import arriving, leave

    received: list[int] = []

    def take(number: int) -> None:
        received.append(number)
        if len(received) > 1:
            leave(128 + received[0])  # its workers end with it; what is done is whole, as after kill -9
        raise KeyboardInterrupt

    before = {number: signal.signal(number, arriving(take)) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield
    except KeyboardInterrupt as ended:
        outcome = str(ended) or "ended"
        echo(f"observer: fleet {verb}: {outcome}; the same command continues with the rest", err=True)
        leave(128 + received[0])
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
