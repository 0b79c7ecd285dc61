"""Commands that take a log as it is: replay, forecast, heats, open-loop prediction, and what other recorders
wrote made a log; results as files.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

from observer.errors import LogError
from observer.estimate.pipeline import MachineModel
from observer.files.documents import write_json
from observer.files.folders import results_in
from observer.files.logs import suffix_of
from observer.files.writer import TableWriter
from observer.frames import FloatArray
from observer.history.history import MethodOptions
from observer.installation import Installation, load
from observer.library.given import read_program, recorded
from observer.library.profiles import Report

if TYPE_CHECKING:
    from observer.intake.importing import Proposal
    from observer.library.comparing import Comparison
    from observer.library.steady import SteadyScrew

Progress = Callable[[int, int], None]


def replay(
    log_path: Path,
    config: Installation,
    output: Path,
    suffix: str,
    *,
    progress: Progress,
    machine: MachineModel | None = None,
    picture: bool = True,
    **accept: bool,
) -> dict[str, Any]:
    """Run a log through the live path; write estimates, `summary.json` and `overview.png` into `output`.

    `machine` is what was built of the same configuration before; `picture` says whether there is to be one.
    `accept` is handed to `read_log`. Returns the summary. Raises `LogError` or `ConfigError`.
    """
    from observer.library.replaying import replayed, title_of_replay
    from observer.report.pictures import draw_overview, written

    log = recorded(log_path, config, **accept)
    machine = machine or MachineModel.of(config, learns=True)
    with results_in(output) as part:
        with TableWriter(part / f"estimates{suffix}") as sink:  # block by block, for a log may be long
            summary, samples = replayed(log, config, sink, progress, machine, picture)
        write_json(part / "summary.json", summary)
        if samples is not None:
            with written(part / "overview.png") as figure:
                draw_overview(figure, config, samples, title_of_replay(log))
    return summary


def forecast(
    log_path: Path,
    config: Installation,
    output: Path,
    *,
    program: Path | None,
    hours: float | None,
    progress: Progress,
    warn: Callable[[list[str]], None] = lambda _doubts: None,
    **accept: bool,
) -> list[str]:
    """Replay a log and forecast from its end; write `forecast.csv`, `.json` and `.png` into `output`.

    The program is learnt from the log's end, or given as a log of the input channels. `accept` is handed to
    `read_log`, `warn` gets the doubts about the log. Returns sentences. Raises `LogError` or `ConfigError`.
    """
    from observer.library.predicting import forecast_run

    log = recorded(log_path, config, **accept)
    follows = None if program is None else read_program(program, config)
    found = forecast_run(log, config, follows, hours, progress)
    found.write(output)
    warn(list(found.doubts))
    return list(found.sentences)


class HeatFiles(NamedTuple):
    """The suffix of the heats' file, and whether a picture is drawn."""

    suffix: str = ".csv"
    picture: bool = True


def identify(
    log_path: Path,
    config: Installation,
    output: Path,
    options: MethodOptions,
    *,
    progress: Callable[[str], None],
    files: HeatFiles = HeatFiles(),  # noqa: B008 (it is frozen)
    report: Report | None = None,
    **accept: bool,
) -> dict[str, Any]:
    """Estimate the heats over a whole log at once; write `heat.csv`, `summary.json` and `heat.png`.

    A `report` is written as `report.csv` and `report.png`. `accept` is handed to `read_log`. Returns the
    summary. Raises `LogError`, `ConfigError` or `UserError`.
    """
    from observer.library.heats import identified_heats

    options.check()
    progress("reading the log")
    log = recorded(log_path, config, **accept)
    found = identified_heats(log, config, options, progress)
    along = None
    if report is not None:
        from observer.library.profiles import profiles

        progress("temperatures and thermal error")
        along = profiles(log, config, found, report)
    progress("writing and drawing")
    found.write(output, files.suffix.removeprefix("."), picture=files.picture)
    if along is not None:
        from observer.library.profiles import write_report

        write_report(along, output)
    return dict(found.summary)


def simulate(
    program: Path,
    config: Installation,
    output: Path,
    start_degC: float | None,
    progress: Progress,
    warn: Callable[[list[str]], None] = lambda _sentences: None,
) -> FloatArray:
    """Predict a run from the heat laws alone and write it as a log, with `overview.png` beside it.

    The program is a log of the input channels; where it also holds the sensors' channels, their first values
    give the initial field. `warn` gets what is doubtful about it. Returns the last predicted sensor
    temperatures in °C.
    """
    from observer.library.predicting import simulated_run

    suffix_of(output)
    run = simulated_run(read_program(program, config), config, start_degC, progress)
    warn(list(run.doubts))
    run.write(output.parent, output.name)
    return run.last_degC


def simulate_steady(
    config: Installation, inputs: Mapping[str, float], program: Path | None, output: Path
) -> SteadyScrew:
    """Find where a machine settles; write `steady.csv`, `steady.json` and `steady.png` into `output`.

    The inputs last; with a program the others are its mean. Raises `ConfigError` or `LogError`.
    """
    from observer.library.steady import steady_screw

    found = steady_screw(config, inputs, program)
    found.write(output)
    return found


def compare(
    config_path: Path,
    variants_path: Path,
    log_path: Path | None,
    output: Path,
    progress: Callable[[str, float], None],
    *,
    steady: bool,
    minimise: Literal["error"] | None,
) -> Comparison:
    """Compare variants of a machine; write `compare.csv`, `compare.json` and `compare.png` into `output`.

    Raises `ConfigError` or `LogError`.
    """
    from observer.library.comparing import compare_given

    config, source = load(config_path), config_path.read_bytes()
    found = compare_given(
        config, source, variants_path, log_path, steady=steady, minimise=minimise, progress=progress
    )
    found.write(output)
    return found


def extract_log(paths: Sequence[Path], config: Installation | None, output: Path) -> int:
    """Write an extract of files to send to support; return its size in bytes. Raises `LogError`."""
    from observer.intake.extract import extract_of
    from observer.tables.logs import Logs

    data = extract_of(paths, Logs() if config is None else config.log).encode("utf-8", "replace")
    try:
        output.write_bytes(data)
    except OSError as error:
        raise LogError(f"{output}: cannot be written ({error.strerror}); choose another place") from None
    return len(data)


class ImportOptions(NamedTuple):
    """The options of an import that override `[log]`: columns as `CHANNEL=COLUMN`, and the clock."""

    columns: Sequence[str] = ()
    time: str | None = None
    time_format: str | None = None
    timezone: str | None = None


def import_log(
    paths: Sequence[Path],
    config: Installation,
    output: Path,
    agree: Callable[[Proposal], bool] | None,
    options: ImportOptions = ImportOptions(),  # noqa: B008 (it is frozen)
) -> Proposal:
    """Write files as one log, by `[log]`, the options and guesses; return the result.

    `agree` is asked once where something is doubtful; without it that is an error, which names the keys of
    `[log]` that settle it. Raises `LogError`.
    """
    from pydantic import ValidationError

    from observer.files.writer import write_log
    from observer.intake.importing import column_option, proposed
    from observer.tables.logs import Logs

    suffix_of(output)
    given = config.log.model_dump(exclude_unset=True)
    clock = {key: value for key, value in options._asdict().items() if key != "columns" and value}
    given |= clock
    given["columns"] = config.log.columns | dict(map(column_option, options.columns))
    if unknown := [name for name in given["columns"] if name not in config.channels]:
        known = ", ".join(config.channels)
        raise LogError(f"--column: the model reads no channel {unknown[0]}; it reads {known}")
    try:
        how = Logs.model_validate(given)
    except ValidationError as error:
        wrong = error.errors()[0]
        option = "--" + str(wrong["loc"][0]).replace("_", "-")
        raise LogError(f"{option}: {wrong['msg'].removeprefix('Value error, ')}") from error
    found = proposed(paths, config, how)
    if found.asked and (agree is None or not agree(found)):
        said = [f"  {key}: {doubt}" for key, doubt in found.asked.items()]
        first = f"{output}: not written, because this is doubtful; clarify it in the configuration:"
        raise LogError("\n".join([first, *said, "the guess was", found.table]))
    log = found.log
    write_log(
        output, log.time_s, {name: log.values[:, i] for i, name in enumerate(log.channels)}, found.doubts
    )
    return found
