"""The verb that makes a log of files from other recorders."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer

from observer.cli.output import warn
from observer.errors import UserError
from observer.terminal import echo

verbs = typer.Typer()


@verbs.command(name="import")
def import_(
    file: Annotated[list[Path], typer.Argument(help="One or more files of one run, joined on their clocks.")],
    config: Annotated[Path | None, typer.Option("--config", "-c", help="Configuration (TOML).")] = None,
    output: Annotated[
        Path | None, typer.Option("--output", "-o", help="Log to write: .parquet, .csv or .csv.gz.")
    ] = None,
    extract: Annotated[
        Path | None,
        typer.Option(
            help="Write an extract of less than 20 kB to send to support, which shows how the files were "
            "read; needs neither --config nor --output."
        ),
    ] = None,
    column: Annotated[
        list[str] | None,
        typer.Option(
            metavar="CHANNEL=COLUMN",
            help="Column of a channel, followed by @UNIT where its name lacks the unit.",
        ),
    ] = None,
    time: Annotated[str | None, typer.Option(help="Column of the time.")] = None,
    time_format: Annotated[
        str | None,
        typer.Option(help="Its unit (ms, min, excel …) or format (%d.%m.%Y %H:%M:%S)."),
    ] = None,
    timezone: Annotated[
        str | None, typer.Option(help="Time zone of times that have none, such as Europe/Berlin.")
    ] = None,
    yes: Annotated[
        bool, typer.Option("--yes", help="Ask nothing; fail where something is doubtful.")
    ] = False,
) -> None:
    """Make a log of files from other recorders, and print the table that reads them directly."""
    from observer import app as parts
    from observer.installation import load
    from observer.intake.importing import Proposal

    if extract is not None:
        written = parts.extract_log(file, None if config is None else load(config), extract)
        echo(f"{written} bytes written to {extract}; read them before you send them")
        if output is None:
            return
    if config is None or output is None:
        raise UserError("import: give --config and --output, or --extract alone")

    def show(found: Proposal) -> None:
        lines = [("channel", "column", "unit", "first values"), *found.shown]
        widths = [max(len(line[i]) for line in lines) for i in range(3)]
        for line in lines:
            cells = [cell.ljust(width) for cell, width in zip(line[:3], widths, strict=True)]
            echo("  ".join([*cells, *line[3:]]).rstrip())

    def agree(found: Proposal) -> bool:
        show(found)
        for key, doubt in found.asked.items():
            echo(f"doubtful: {key}: {doubt}")
        return typer.confirm("Is that right?", default=False)

    asks = not yes and sys.stdin.isatty()
    options = parts.ImportOptions(column or (), time, time_format, timezone)
    found = parts.import_log(file, load(config), output, agree if asks else None, options)
    if not (asks and found.asked):
        show(found)
    warn([*found.log.doubts, *(words.text for words in found.log.words)])
    log = found.log
    span_s = float(log.time_s[-1] - log.time_s[0])
    echo(f"{len(log)} rows over {span_s:.6g} s written to {output}")
    if found.zoneless:
        echo("the times have no zone and were taken as they are; --timezone converts them to UTC")
    echo(f"such files are read directly with this in the configuration:\n{found.table}")
