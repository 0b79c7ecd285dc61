"""The verb that makes a log of files from other recorders."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, NamedTuple

import typer

from observer.cli.options import flattened
from observer.cli.output import warn
from observer.errors import UserError
from observer.process.terminal import echo

if TYPE_CHECKING:
    from observer.intake.importing import ImportedLog

verbs = typer.Typer()


class TimeChoices(NamedTuple):
    """Options that say how the files give the time."""

    time: Annotated[str | None, typer.Option(help="Column of the time.")] = None
    time_format: Annotated[
        str | None,
        typer.Option(help="Its unit (ms, min, excel …) or format (%d.%m.%Y %H:%M:%S)."),
    ] = None
    timezone: Annotated[
        str | None, typer.Option(help="Time zone of times that have none, such as Europe/Berlin.")
    ] = None


@verbs.command(name="import")
@flattened
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
    *,
    times: TimeChoices,
    yes: Annotated[
        bool, typer.Option("--yes", help="Ask nothing; fail where something is doubtful.")
    ] = False,
) -> None:
    """Make a log of files from other recorders, and print the table that reads them directly."""
    from observer.files.logs import suffix_of
    from observer.library.importing import extract_log, import_log
    from observer.library.machine import load

    if extract is not None:
        size = extract_log(file, extract, config)
        echo(f"{size} bytes written to {extract}; read them before you send them")
        if output is None:
            return
    if config is None or output is None:
        raise UserError("import: give --config and --output, or --extract alone")
    suffix_of(output)
    columns = dict(map(_channel_and_column, column or ()))
    machine = load(config)
    imported = import_log(file, machine, columns=columns, **times._asdict())
    agreed = False
    if imported.asked and not yes and sys.stdin.isatty():
        _show(imported)
        for key, doubt in imported.asked.items():
            echo(f"doubtful: {key}: {doubt}")
        agreed = typer.confirm("Is that right?", default=False)
    imported.write(output, agreed=agreed)
    if not agreed:
        _show(imported)
    log = imported.log
    warn([*log.doubts, *(words.text for words in log.words)])
    span_s = float(log.time_s[-1] - log.time_s[0])
    echo(f"{len(log)} rows over {span_s:.6g} s written to {output}")
    if imported.zoneless:
        echo("the times have no zone and were taken as they are; --timezone converts them to UTC")
    echo(f"such files are read directly with this in the configuration:\n{imported.table}")


def _channel_and_column(text: str) -> tuple[str, str]:
    """Return the channel and the column of `CHANNEL=COLUMN`. Raises `UserError`."""
    channel, mark, column = text.partition("=")
    if not mark or not channel.strip() or not column.strip():
        raise UserError(f"--column: {text!r}: write CHANNEL=COLUMN, as t1_degC=Temp1 or t1_degC=Temp1@degF")
    return channel.strip(), column


def _show(imported: ImportedLog) -> None:
    """Print the channels with their columns, units and first values."""
    lines = [("channel", "column", "unit", "first values"), *imported.shown]
    widths = [max(len(line[i]) for line in lines) for i in range(3)]
    for line in lines:
        cells = [cell.ljust(width) for cell, width in zip(line[:3], widths, strict=True)]
        echo("  ".join([*cells, *line[3:]]).rstrip())
