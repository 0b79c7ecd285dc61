"""The verbs for a machine: the demo, the daemon, and its preparation."""

from __future__ import annotations

import sys
from inspect import Parameter
from pathlib import Path
from typing import Annotated, Literal, NamedTuple

import typer

from observer.cli.options import (
    DEFAULT_ENDPOINT,
    ClientOption,
    ConfigOption,
    JsonOption,
    OutputOption,
    SecondsOption,
    endpoint,
    flattened,
    picture,
    with_parameters,
)
from observer.cli.output import advancing, counting, print_error, show
from observer.errors import UserError
from observer.files.folders import results_in
from observer.process import shutdown
from observer.process.terminal import echo

verbs = typer.Typer()


@verbs.command()
def demo(
    seconds: SecondsOption = None,
    listen: Annotated[
        str, typer.Option(help="Where the demo's Zenoh router listens.", callback=endpoint)
    ] = DEFAULT_ENDPOINT,
    plain: Annotated[
        bool, typer.Option("--plain", help="One line per second instead of the live table.")
    ] = False,
    page: Annotated[
        str | None, typer.Option(help="Address of the page; default: the first free port from 8080 on.")
    ] = None,
    no_page: Annotated[bool, typer.Option("--no-page", help="Without the page.")] = False,
    record: Annotated[
        Path | None,
        typer.Option(help="Keep the recordings in this folder; default: not kept."),
    ] = None,
    sensors: Annotated[
        Literal["screw", "housings"],
        typer.Option(help="Thermocouples along the screw, or on nut and housings only."),
    ] = "screw",
) -> None:
    """Run the service on a simulated machine with Modbus and CAN; show estimates beside the true heats."""
    from pydantic import ValidationError

    from observer.cli.demo import run_demo
    from observer.config.outlets import Page

    try:
        shown = None if no_page else Page() if page is None else Page(listen=page)
    except ValidationError as error:
        raise typer.BadParameter(
            str(error.errors()[0]["msg"]).removeprefix("Value error, "), param_hint="--page"
        ) from None
    shutdown.leave(run_demo(seconds, listen, plain or not sys.stdout.isatty(), shown, record, sensors))


@verbs.command()
def run(
    config: Annotated[list[Path], typer.Option("--config", "-c", help="Configuration (TOML).")],
    seconds: SecondsOption = None,
    log_format: Annotated[Literal["text", "json"], typer.Option(help="Format of the messages.")] = "text",
) -> None:
    """Run the daemon of one axis beside the CNC until SIGTERM or Ctrl-C."""
    if len(config) > 1:
        raise UserError(
            "run: give one --config, since a process serves one axis; for several, run an instance of the "
            "systemd unit or a container for each (docs/how-to/fleet.md)"
        )
    from observer.process.memory import import_sparingly, not_found

    import_sparingly()
    from observer.process.messages import configure
    from observer.service.daemon import serve_file

    configure(as_json=log_format == "json")
    try:
        # python-can would load it, and with it pandas, to read measurement files, which no daemon does
        with not_found("asammdf"):
            serve_file(config[0], seconds)
    except UserError as error:
        print_error(error)
        shutdown.leave(2)  # threads of parts that had been started may hang at the interpreter's exit
    shutdown.leave(0)


@verbs.command()
def outlets(
    config: ConfigOption,
    connect: Annotated[
        str | None,
        typer.Option(
            help="Zenoh endpoint of the service or its router; default: that of the configuration.",
            callback=lambda option, text: text and endpoint(option, text),
        ),
    ] = None,
    client: ClientOption = None,
) -> None:
    """Serve page, Prometheus, MQTT and OPC UA beside a service that does not, until SIGTERM or Ctrl-C."""
    from observer.process.memory import import_sparingly

    import_sparingly()
    from observer.installation import load, load_client
    from observer.outlets.process import serve_until_signal
    from observer.outlets.start import Start

    login = None if client is None else load_client(client)
    settings = load(config)
    if settings.outlets.start and connect is None:
        raise UserError(
            f"{config}: the service starts these outlets itself; set [outlets] start = false, or name the "
            "service with --connect"
        )
    start = Start.of(settings, connect or "", login)
    if start is None:
        raise UserError(
            f"{config}: no outlet to serve; add [page], [metrics], [mqtt], [opcua] or [outlets.also.…]"
        )
    serve_until_signal(start)


_QUESTIONS = {
    "machine": "Name of the machine, such as lathe-7",
    "axis": "Its axis",
    "screw": "Screw, nominal diameter x lead in mm, such as 40 x 10; any size",
    "steel": "Its steel: bearing, case, carbon, stainless",
    "length_m": "Length between the bearings, such as 1000 mm or 1.0 m",
    "stroke_m": "Stroke of the nut's middle: both ends from the bearing you count as left (the upper one "
    "of a vertical axis), such as 150 800 mm",
    "mounting": "How bearings hold the screw: fixed-supported, fixed-fixed, fixed-free, floating or unknown",
    "fixed_end": "Which end is fixed: left or right (upper or lower)",
    "housings": "Housings that carry a thermocouple: nut, left, right (upper, lower), several, all or none",
    "nut_kg": "Mass of the nut with what is bolted to it, in kg; Enter if you do not know it",
    "housing_kg": "Mass of a bearing's housing, in kg; Enter if you do not know it",
    "sensors_m": "Thermocouples on the screw itself: distance from the left bearing, such as 50 500 950 mm; "
    "Enter if there are none",
    "module": "Module that reads the thermocouples, at its first inputs in the order nut, left, right, "
    "screw, air: wago_750_458, icpdas_m7018, micro800_tc2, css_canmod_temp, peak_mu_thermocouple1, or other",
    "module_bus": "other module: its bus, modbus (TCP or serial), or other",
    "module_at": "Address of the module: 192.168.0.20, 192.168.0.20:502, /dev/ttyUSB0 or can0",
    "transport": "What that address speaks: tcp (Modbus TCP), or rtu-over-tcp (a serial server)",
    "module_unit": "Modbus unit of the module (slave address)",
    "function": "other module: its registers are holding (function 3, 4xxxx) or input (function 4, 3xxxx)",
    "first_register": "other module: register of the first temperature, from 0, or as in the manual (40001)",
    "type": "other module: type of a value: int16, uint16, int32, uint32, float32, float64",
    "word_order": "other module: big where the high word comes first, little where the low one does",
    "degrees_per_count": "other module: °C of one count, such as 0.1; Enter for 0.1 (1 of float)",
    "step": "other module: registers from one temperature to the next; Enter if they follow each other",
    "inputs": "other module: number of its inputs",
    "fault_code": "other module: what it sends for an open input, such as 32767 or 0x7FFF; Enter if unknown",
    "ambient": "Air temperature, such as 21.5 °C, or input: the module's next input",
    "control": "Where the position comes from: canopen, modbus, can, opcua, mtconnect, other, or none yet",
    "control_at": "Address of the control: 192.168.0.21, can0, /dev/ttyACM0, opc.tcp://192.168.0.21:4840, "
    "http://192.168.0.21:5000",
    "node_id": "canopen: the drive's node",
    "counts_per_m": "canopen, modbus: counts per metre; negative if the control counts towards the left "
    "bearing",
    "position_register": "modbus: first register of the position, from 0, or the manual's number (40001)",
    "position_type": "modbus: type of the position: int16, uint16, int32, uint32, float32, float64",
    "position_word_order": "modbus: big where the position's high word comes first, little for the low one",
    "speed_register": "modbus: register of the screw's speed in rpm; Enter if there is none",
    "dbc": "can: the DBC file",
    "position_signal": "Name of the position there, such as AxisStatus.NutPosition (can), ns=2;s=X.Position "
    "(opcua), Xpos (mtconnect)",
    "speed_signal": "Name of the screw's speed in rpm, likewise; Enter if there is none",
    "shown_at_ends_m": "What the control shows with the nut at the left, and at the right end of its stroke, "
    "such as 0 650 mm; Enter if you do not know",
}
"""Each is an option of `init`, and is asked where that is not given."""
_USUAL = {
    "machine": "machine",
    "axis": "x",
    "screw": "40x10",
    "steel": "bearing",
    "mounting": "unknown",
    "fixed_end": "left",
    "module": "wago_750_458",
    "module_bus": "modbus",
    "transport": "tcp",
    "module_unit": "1",
    "function": "input",
    "first_register": "0",
    "type": "int16",
    "word_order": "big",
    "inputs": "8",
    "ambient": "input",
    "control": "none",
    "position_register": "0",
    "position_type": "int32",
    "position_word_order": "big",
}
"""Their defaults, as `Answers` has them, which is slow to import."""


def init(
    output: Annotated[
        Path, typer.Option("--output", "-o", help="File to write; an existing one is not overwritten.")
    ] = Path("observer.toml"),
    **answers: str | None,
) -> None:
    """Write a first configuration; asks for whatever is not given as an option."""
    from observer.installation.first_configuration import write_new

    def ask(name: str, usual: str | None, trouble: str) -> str:
        if trouble:
            echo(trouble)
        return str(typer.prompt(_QUESTIONS[name], default=usual))

    write_new(output, answers, ask if sys.stdin.isatty() else None)
    echo(
        f'written: {output}. Values marked "look" in it are typical ones. Next:\n'
        f"  observer check --config {output}           what it means\n"
        f"  observer check --config {output} --wires   what each device delivers\n"
        f"  observer run --config {output}             the service"
    )


def _option(name: str) -> Parameter:
    usual = f"; default {_USUAL[name]}" if name in _USUAL else ""
    kind = Annotated[str | None, typer.Option(help=_QUESTIONS[name] + usual)]
    return Parameter(name, Parameter.KEYWORD_ONLY, default=None, annotation=kind)


verbs.command()(with_parameters(init, map(_option, _QUESTIONS)))


@verbs.command()
def check(
    config: ConfigOption,
    wires: Annotated[
        bool,
        typer.Option(
            "--wires", help="Try the devices for some seconds; exit code 0 if every channel is usable."
        ),
    ] = False,
    as_json: JsonOption = False,
) -> None:
    """Show what a configuration means: modes, observability, poles, noise gain, warnings."""
    from observer.installation.examine import examine
    from observer.report.check_text import as_text, wires_as_text

    settings = examine(config)
    if wires:
        from observer.service.wire_doubts import wires_of

        wires_document = wires_of(settings)
        show(wires_document, as_json, wires_as_text)
        shutdown.leave(0 if wires_document["good"] else 1)
    from observer.report.check import findings

    show(findings(settings), as_json, as_text)


class PlaceChoices(NamedTuple):
    """Options of the search for sensors."""

    budget: Annotated[
        float | None,
        typer.Option(min=0.0, help="Budget, in the unit of the costs; default: no limit."),
    ] = None
    candidates: Annotated[
        Path | None,
        typer.Option(
            help="File of candidate tables: what can be mounted; default: those of the configuration."
        ),
    ] = None
    by: Annotated[
        Literal["all", "heat", "field", "error"], typer.Option(help="The σ by which sets are judged.")
    ] = "all"
    keep: Annotated[bool, typer.Option("--keep", help="Keep the configured sensors, and add to them.")] = (
        False
    )
    spacing_m: Annotated[
        float | None,
        typer.Option(
            min=1e-4,
            help="Without candidates: spacing of positions on the screw in m; default: 41 positions.",
        ),
    ] = None


@verbs.command()
@flattened
def place(
    config: ConfigOption,
    sensors: Annotated[
        int | None,
        typer.Option(
            min=1,
            max=32,
            help="Largest number of sensors in a set, those kept included; default: two more than heats, "
            "beside those kept.",
        ),
    ] = None,
    *,
    choices: PlaceChoices,
    plot: Annotated[
        Path | None, typer.Option(help="Also draw σ against cost into this file (.png, .svg, .pdf).")
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Find the sensors, among those that can be mounted, that leave the smallest σ for their cost."""
    from observer.library.machine import load
    from observer.report.placing import as_text

    picture(plot)
    machine = load(config)
    with advancing("place") as progress:
        placed = machine.place(sensors, progress=progress, **choices._asdict())
    if plot is not None:
        placed.draw(plot)
    show(placed.document, as_json, as_text)


@verbs.command()
def export(
    config: ConfigOption,
    output: OutputOption,
    format: Annotated[
        Literal["c99", "st", "fmu", "npz", "mat", "json", "table"],
        typer.Option(
            help="c99: C without a library; st: IEC 61131-3 structured text; fmu: FMU 3.0 of observer and "
            "plant; npz, mat, json: the plant's matrices; table: the compensation at the end of a log."
        ),
    ] = "c99",
    log: Annotated[
        Path | None,
        typer.Option(help="c99, st, fmu: run the reference over this log as well; table: the log."),
    ] = None,
    control: Annotated[
        Literal["linuxcnc", "klipper", "sinumerik"], typer.Option(help="table: the control that reads it.")
    ] = "linuxcnc",
    axis: Annotated[str, typer.Option(help="table: the control's name of the axis.")] = "X",
    single: Annotated[bool, typer.Option("--single", help="st: REAL instead of LREAL.")] = False,
) -> None:
    """Write the constant-gain observer as code for a controller, the plant, or a table."""
    from observer.library.machine import load

    with results_in(output), counting("export", "estimating", "comparing and writing") as progress:
        exported = load(config).export(
            format, log=log, progress=progress, control=control, axis=axis, single=single
        )
        exported.write(output)
    for line in exported.facts:
        echo(line)
    echo(f"written to {output}: {', '.join(exported.files)}")
