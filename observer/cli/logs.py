"""The verbs for logs: replay, forecast, fit, search and adoption."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple

import typer

from observer.cli.cases import case_as_table, comparison_as_text
from observer.cli.options import (
    ConfigOption,
    LogArgument,
    OutputOption,
    accepting,
    assignments,
    flattened,
)
from observer.cli.output import advancing, counting, show, show_sentence, warn, warn_of_paths
from observer.errors import UserError
from observer.files.folders import results_in
from observer.process.terminal import echo

verbs = typer.Typer()


@verbs.command()
@accepting
def replay(
    log: LogArgument,
    config: ConfigOption,
    output: OutputOption,
    format: Annotated[Literal["csv", "parquet"], typer.Option(help="Format of the estimates.")] = "csv",
    **accept: Any,
) -> None:
    """Run a recorded log through the same path as live: estimates, summary.json, overview.png."""
    from observer.library.machine import load

    with results_in(output), counting("replay", "estimating", "writing and drawing") as progress:
        estimates = load(config).replay(log, progress=progress, **accept)
        estimates.write(output, format)
    summary = estimates.summary
    if summary["start"] != "cold":
        echo(f"start: {summary['start']}")
    quality = ", ".join(f"{n} {name}" for name, n in summary["quality"].items() if n)
    echo(f"{summary['rows']} estimates over {summary['duration_s']:.6g} s: {quality}")
    for name, mean_W in summary["heat_mean_W"].items():
        echo(f"  {name}: {'unknown' if mean_W is None else f'{mean_W:.2f} W'} on average")
    for reason, steps in summary["reasons"].items():
        echo(f"not good in {steps} estimates: {reason}", err=True)
    for reason, steps in summary["heat_reasons"].items():
        echo(f"heats not good in {steps} estimates: {reason}", err=True)
    warn(summary["doubts"])
    warn_of_paths(summary["nut_path"])
    echo(f"written to {output}: estimates.{format}, summary.json, overview.png")


@verbs.command()
@accepting
def forecast(
    log: LogArgument,
    config: ConfigOption,
    output: OutputOption,
    program: Annotated[
        Path | None,
        typer.Option(
            help="Program that runs next, a log of the input channels, repeated; default: as at the end "
            "of the log."
        ),
    ] = None,
    hours: Annotated[
        float | None, typer.Option(min=0.05, max=24.0, help="Hours ahead; else as configured.")
    ] = None,
    **accept: Any,
) -> None:
    """Forecast what follows a log: temperatures and thermal error with sigma, and when they settle."""
    from observer.library.machine import load

    with results_in(output), counting("forecast", "estimating", "looking ahead") as progress:
        ahead = load(config).forecast(log, program=program, hours=hours, progress=progress, **accept)
        ahead.write(output)
    for line in ahead.sentences:
        show_sentence(line)
    warn([*ahead.doubts])
    echo(f"written to {output}: forecast.csv, forecast.json, forecast.png")


class HeatChoices(NamedTuple):
    """Options of the methods that find heats."""

    regularisation: Annotated[
        float | None,
        typer.Option(help="Weight of the prior, 1 as configured; default: chosen by the method."),
    ] = None
    parameter_choice: Annotated[
        Literal["discrepancy", "gcv", "l-curve", "ico"] | None,
        typer.Option(
            metavar="RULE",
            help="Choice of that weight by tikhonov: discrepancy, gcv (default), l-curve or ico.",
        ),
    ] = None
    order: Annotated[
        int | None,
        typer.Option(min=0, max=1, help="Prior: 0 independent heats, 1 random walks (default)."),
    ] = None
    gradient: Annotated[
        Literal["adjoint", "central-differences"] | None,
        typer.Option(
            metavar="HOW", help="Gradient for conjugate-gradient: adjoint (default) or central-differences."
        ),
    ] = None
    seed: Annotated[int, typer.Option(min=0, help="Random seed.")] = 0


class GridChoices(NamedTuple):
    """Options of a report along the screw."""

    report: Annotated[
        bool, typer.Option("--report", help="Also temperatures, heats and errors along the screw.")
    ] = False
    every_m: Annotated[
        float | None, typer.Option(help="Spacing of the report over the stroke in m; else as configured.")
    ] = None
    every_min: Annotated[float, typer.Option(help="Minutes between the report's times.")] = 10.0


@verbs.command()
@accepting
@flattened
def identify(
    log: LogArgument,
    config: ConfigOption,
    output: OutputOption,
    method: Annotated[
        Literal["smoother", "tikhonov", "conjugate-gradient"],
        typer.Option(metavar="METHOD", help="Method: smoother, tikhonov or conjugate-gradient."),
    ] = "smoother",
    *,
    choices: HeatChoices,
    grid: GridChoices,
    **accept: Any,
) -> None:
    """Estimate the heats of a whole log from all its rows at once: heat.csv, summary.json, heat.png."""
    from observer.library.machine import load
    from observer.library.profiles import ReportGrid

    places = ReportGrid(grid.every_m, 60.0 * grid.every_min)
    places.check()
    reports = grid.report or grid.every_m is not None
    with results_in(output), advancing("identify") as progress:
        heats = load(config).identify(
            log, method, report=places if reports else None, progress=progress, **choices._asdict(), **accept
        )
        progress("writing and drawing")
        heats.write(output)
    summary = heats.summary
    echo(f"{summary['rows']} rows over {summary['duration_s']:.6g} s by {method}")
    for name, mean_W in summary["heat_mean_W"].items():
        sigma_W = summary["heat_sigma_mean_W"][name]
        echo(f"  {name}: {mean_W:.2f} W on average, σ {sigma_W:.2f} W at a time")
    warn([*summary["warnings"], *summary["doubts"]])
    warn_of_paths(summary["nut_path"])
    with_report = ", report.csv, report.png" if reports else ""
    echo(f"written to {output}: heat.csv, summary.json, heat.png{with_report}")


@verbs.command()
def simulate(
    config: ConfigOption,
    output: Annotated[
        Path,
        typer.Option(
            "--output", "-o", help="Log to write: .csv, .csv.gz or .parquet; with --steady the folder."
        ),
    ],
    program: Annotated[
        Path | None, typer.Option(help="Log of the input channels (speed, position, power …).")
    ] = None,
    start_degC: Annotated[
        float | None,
        typer.Option(help="Screw temperature at the start in °C; else by sensors or ambient."),
    ] = None,
    steady: Annotated[
        bool,
        typer.Option(
            "--steady", help="The steady state instead: with the inputs of --at, or a program's means."
        ),
    ] = False,
    at: Annotated[
        list[str] | None,
        typer.Option(metavar="CHANNEL=VALUE", help="steady: a constant input; repeat the option for each."),
    ] = None,
) -> None:
    """Predict a run from the heat laws alone, as a log with overview.png beside it; or the steady state."""
    from observer.files.logs import suffix_of
    from observer.library.machine import load

    if steady:
        if start_degC is not None:
            raise UserError("simulate: the steady state does not depend on --start-degc; leave it out")
        settled = load(config).settle(assignments(at or []), program=program)
        settled.write(output)
        show(settled.figures, as_json=False, as_text=case_as_table)
        echo(f"written to {output}: steady.csv, steady.json, steady.png")
        return
    if at:
        raise UserError(
            "simulate: --at belongs to --steady; leave it out, as a program has its inputs as columns"
        )
    if program is None:
        raise UserError("simulate: give --program, a log of the input channels, or --steady")
    suffix_of(output)
    machine = load(config)
    with counting("simulate", "predicting", "writing and drawing") as progress:
        run = machine.simulate(program, start_degC=start_degC, progress=progress)
        run.write(output.parent, output.name)
    ends = ", ".join(
        f"{s.name} {t:.2f} {'°C' if s.kind == 'temperature' else 'µm'}"
        for s, t in zip(machine.config.sensor, run.last_degC, strict=True)
    )
    echo(f"at the end: {ends}")
    warn([*run.doubts])
    echo(f"written: {output}, {output.parent / 'overview.png'}")


@verbs.command()
def compare(
    config: ConfigOption,
    variants: Annotated[Path, typer.Option(help="Variants (TOML): named overrides of the configuration.")],
    output: OutputOption,
    log: Annotated[
        Path | None, typer.Option(help="Log of the input channels: the cycle that each variant runs.")
    ] = None,
    steady: Annotated[
        bool,
        typer.Option(
            "--steady", help="Steady state of each: with its inputs, or the mean inputs of the log."
        ),
    ] = False,
    minimise: Annotated[
        Literal["error"] | None,
        typer.Option(help="error: also find the mounting, preload and gap with the least thermal error."),
    ] = None,
) -> None:
    """Compare variants of a machine: heats, temperatures, thermal error, force, and the σ that remain."""
    from observer.library.machine import load

    with results_in(output), advancing("compare") as progress:
        comparison = load(config).compare(variants, log, steady=steady, minimise=minimise, progress=progress)
        comparison.write(output)
    show(comparison, as_json=False, as_text=comparison_as_text)
    for sentence in comparison.sentences:
        show_sentence(sentence)
    echo(f"written to {output}: compare.csv, compare.json, compare.png")


@verbs.command()
def calibrate(
    log: Annotated[list[Path], typer.Argument(help="One or more logs of the same machine.")],
    config: ConfigOption,
    output: OutputOption,
) -> None:
    """Fit the parameters that the configuration declares free; write config.toml and calibration.json, or
    end with code 1 if the configured values predict the held-back part of the logs better.
    """
    from observer.library.machine import load

    with results_in(output), advancing("calibrate") as progress:
        calibrated = load(config).calibrate(log, progress=progress)
        calibrated.write(output)
    result = calibrated.document
    for key, fitted in result["calibrated"].items():
        low, high = fitted["ci95"]
        echo(f"{key} = {fitted['value']:g} ({low:g} … {high:g}), was {fitted['before']:g}")
    for regimes in result["nut_path"].values():
        warn_of_paths(regimes)
    warn([*result["not_told"], *result["doubts"], *result["left_out"]])
    for key, value in (result["left"] | result["process_noise"]).items():
        echo(f"{key} = {value:g}")
    for part, gap in (
        ("whole log", result["gap"]),
        (f"held back, {result['held_back']['seconds'] / 60.0:.0f} min", result["held_back"]),
    ):
        echo(f"open-loop gap ({part}) {gap['before_rms_K']:g} K rms before, {gap['after_rms_K']:g} K after")
    if result["kept"] is None:
        echo(f"written to {output}: config.toml, calibration.json")
        return
    show_sentence(result["kept"])
    echo(f"written to {output}: calibration.json, and no config.toml")
    raise typer.Exit(1)


@verbs.command()
def learned(config: ConfigOption, output: OutputOption) -> None:
    """Write the configuration with the parameters its service has learnt, such as film and offsets."""
    from observer.library.machine import load

    learnt = load(config).learned()
    learnt.write(output)
    echo(repr(learnt))
    echo(f"written to {output}: config.toml, learned.json")


@verbs.command()
def discover(
    config: ConfigOption,
    output: OutputOption,
    log: Annotated[
        list[Path] | None,
        typer.Argument(help="Logs of the same machine; the last one, or its end, is kept as proof."),
    ] = None,
    recent: Annotated[
        str | None,
        typer.Option(help="Instead of logs, the service's recordings of the last 90min, 8h, 2d …"),
    ] = None,
) -> None:
    """Find the physical effect that the model lacks; add it, and prove that the gap shrinks."""
    if bool(log) == (recent is not None):
        raise UserError(
            "discover: name either logs or --recent with a duration, as in --recent 8h, and not both"
        )
    from observer.library.machine import load
    from observer.record.recent import duration_s

    recent_s = None if recent is None else duration_s(recent)
    with results_in(output), advancing("discover") as progress:
        discovery = load(config).discover(log or None, recent_s=recent_s, progress=progress)
        progress("writing the report", 0.97)
        result = discovery.write(output)
    if recent is not None:
        for name in result["logs"]:
            echo(f"searched: {name}")
    warn(result["doubts"])
    for sentence in discovery.sentences:
        show_sentence(sentence)
    written = "config.toml, " if result["effects"] else "candidate.toml, " if result["partial"] else ""
    echo(f"written to {output}: {written}result.json, report.html")
    step = result["next"]
    show_sentence(f"next: {step['text']}{':' if step['command'] else '.'}")
    if step["command"]:
        echo(f"  {step['command']}")


@verbs.command()
def adopt(
    config: ConfigOption,
    folder: Annotated[
        Path | None, typer.Argument(metavar="DIR", help="Results of discover or calibrate.")
    ] = None,
    status: Annotated[
        bool, typer.Option("--status", help="Show the state of the last adoption instead.")
    ] = False,
    undo: Annotated[bool, typer.Option("--undo", help="Undo the last adoption instead.")] = False,
    candidate: Annotated[
        bool, typer.Option("--candidate", help="Adopt candidate.toml, which explains part of an unknown.")
    ] = False,
) -> None:
    """Put a found configuration in force, with a way back."""
    if [folder is not None, status, undo].count(True) != 1:
        raise UserError("adopt: name either the folder of results, or --status, or --undo")
    from observer.installation import adopt as adoptions

    if folder is None:
        last = adoptions.undo(config) if undo else adoptions.adoption_of(config)
        echo(f"{config}: " + ("nothing was adopted" if last is None else last.sentence()))
        return
    adoption = adoptions.adopt(folder, config, time.time(), candidate=candidate)
    echo(
        f"{config} is now the configuration of {folder}; the previous one is in {adoption.before}.\n"
        "A running service puts it in force within seconds; --undo restores the previous one."
    )
