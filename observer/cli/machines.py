"""The verbs of a machine: the demo, the daemon, and what comes before it runs."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Annotated, Any, Literal

import typer

from observer.cli.options import (
    DEFAULT_ENDPOINT,
    ConfigOption,
    JsonOption,
    SecondsOption,
    endpoint,
)
from observer.cli.output import say, show
from observer.errors import UserError
from observer.process import shutdown

verbs = typer.Typer()


@verbs.command()
def demo(
    seconds: SecondsOption = None,
    listen: Annotated[
        str, typer.Option(help="Where the demo's Zenoh router listens.", callback=endpoint)
    ] = DEFAULT_ENDPOINT,
    plain: Annotated[bool, typer.Option(help="One line a second in place of the live table.")] = False,
    page: Annotated[
        str | None, typer.Option(help="Where the page listens; by itself the first free port from 8080 on.")
    ] = None,
    no_page: Annotated[bool, typer.Option("--no-page", help="Without the page.")] = False,
) -> None:
    """Run the main job on a simulated machine: real Modbus and CAN, estimates beside the truth."""
    from pydantic import ValidationError

    from observer.demo import run_demo
    from observer.tables.gateway import Page

    try:
        shown = None if no_page else Page() if page is None else Page(listen=page)
    except ValidationError as error:
        raise typer.BadParameter(
            str(error.errors()[0]["msg"]).removeprefix("Value error, "), param_hint="--page"
        ) from None
    shutdown.leave(run_demo(seconds, listen, plain or not sys.stdout.isatty(), shown))


@verbs.command()
def run(
    config: Annotated[list[Path], typer.Option("--config", "-c", help="Configuration (TOML).")],
    seconds: SecondsOption = None,
    log_format: Annotated[Literal["text", "json"], typer.Option(help="How messages are written.")] = "text",
) -> None:
    """Run the daemon of one axis beside the CNC until SIGTERM or Ctrl-C."""
    if len(config) > 1:
        raise UserError(
            "run: one --config, for a process serves one axis; for several, `observer service install` makes "
            "an instance of the service for each, and a container runs one each (docs/how-to/fleet.md)"
        )
    from observer.process.memory import import_sparingly

    import_sparingly()
    from observer.daemon import serve
    from observer.installation import load
    from observer.process.messages import configure

    configure(as_json=log_format == "json")
    try:
        serve(load(config[0]), seconds, config[0])
    except UserError as error:
        say(error)
        shutdown.leave(2)  # threads of parts that had been started may hang at the interpreter's exit
    shutdown.leave(0)


def _answer(words: str) -> Any:
    return typer.Option(help=words, show_default=False)


@verbs.command()
def init(
    output: Annotated[
        Path, typer.Option("--output", "-o", help="File to write; one that is there is not overwritten.")
    ] = Path("observer.toml"),
    machine: Annotated[str | None, _answer("Name of the machine.")] = None,
    axis: Annotated[str | None, _answer("Its axis.")] = None,
    screw: Annotated[str | None, _answer("Screw of the catalogue, as 40x10.")] = None,
    steel: Annotated[str | None, _answer("bearing, case, carbon or stainless.")] = None,
    length_m: Annotated[str | None, _answer("Length between the bearings.")] = None,
    stroke_m: Annotated[str | None, _answer("Where the nut's middle travels, as 0.15,0.80.")] = None,
    sensors_m: Annotated[str | None, _answer("Places of the thermocouples, as 0.05,0.5,0.95.")] = None,
    module: Annotated[str | None, _answer("Thermocouple module, as wago_750_458.")] = None,
    module_at: Annotated[str | None, _answer("Its address, serial line or CAN interface.")] = None,
    ambient: Annotated[str | None, _answer("Air in °C, or input: the module's next input.")] = None,
    control: Annotated[
        str | None, _answer("Position by canopen, modbus, can, opcua, mtconnect or none.")
    ] = None,
    control_at: Annotated[str | None, _answer("Its address, CAN interface or URL.")] = None,
    node_id: Annotated[str | None, _answer("canopen: the drive's node.")] = None,
    counts_per_m: Annotated[str | None, _answer("canopen, modbus: counts per metre.")] = None,
    position_register: Annotated[str | None, _answer("modbus: first of the pair, from 0.")] = None,
    speed_register: Annotated[str | None, _answer("modbus: register of the speed in rpm.")] = None,
    dbc: Annotated[str | None, _answer("can: the DBC file.")] = None,
    position_signal: Annotated[
        str | None, _answer("can: as AxisStatus.NutPosition; opcua: node; mtconnect: item.")
    ] = None,
    speed_signal: Annotated[
        str | None, _answer("can: as AxisStatus.ScrewSpeed; opcua: node; mtconnect: item.")
    ] = None,
) -> None:
    """Write a first configuration: asks for what is not given as an option."""
    given = dict(locals())
    from observer import app as parts

    ask: Any = None
    if sys.stdin.isatty():

        def ask(words: str, usual: str | None) -> str:
            return str(typer.prompt(words, default=usual))

    typer.echo(parts.init(given.pop("output"), given, ask))


@verbs.command()
def check(
    config: ConfigOption,
    wires: Annotated[
        bool, typer.Option(help="Instead, read every device once; exit code 0 if every channel came.")
    ] = False,
    as_json: JsonOption = False,
) -> None:
    """Say what a configuration means: modes, observability, poles, noise gain, warnings."""
    from observer.installation.examine import examine
    from observer.report.check_text import as_text, wires_as_text

    settings = examine(config)
    if wires:
        from observer import app as parts

        found = parts.wires(settings)
        show(found, as_json, wires_as_text)
        shutdown.leave(0 if found["good"] else 1)
    from observer.report.check import findings

    show(findings(settings), as_json, as_text)


@verbs.command()
def place(
    config: ConfigOption,
    sensors: Annotated[int, typer.Option(min=1, max=32, help="How many sensors to place.")],
    spacing_m: Annotated[float | None, typer.Option(min=1e-4, help="Spacing of the candidates.")] = None,
    as_json: JsonOption = False,
) -> None:
    """Rank sensor positions by how well they determine field and heats (conditioning, not rank)."""
    from observer import app as parts
    from observer.installation import load

    sets = parts.place(load(config), sensors, spacing_m)
    if as_json:
        typer.echo(json.dumps(sets, indent=2))
        return
    from rich.console import Console
    from rich.table import Table

    table = Table("sensors", "at, mm", "worst direction seen, K", "condition")
    for found in sets:
        places = "  ".join(f"{1000 * x:g}" for x in found["positions_m"])
        table.add_row(str(found["sensors"]), places, f"{found['score_K']:.3g}", f"{found['condition']:.3g}")
    Console(highlight=False).print(table)


@verbs.command()
def service(
    action: Annotated[Literal["install", "remove"], typer.Argument(help="What is to be done.")],
    config: Annotated[
        list[Path] | None,
        typer.Option("--config", "-c", help="install: the configuration (TOML); given again, another axis."),
    ] = None,
    root: Annotated[Path, typer.Option(help="Put the files below another folder, and run nothing.")] = Path(
        "/"
    ),
    dry_run: Annotated[bool, typer.Option("--dry-run", help="Only say what would be done.")] = False,
) -> None:
    """Install the service with systemd (unit, user, folders), or remove it; configuration and data stay."""
    if (action == "install") != bool(config):
        raise UserError("service: install needs --config, and remove takes none")
    from observer import app as parts

    for line in parts.service(config or [], root, dry_run=dry_run):
        typer.echo(line)
