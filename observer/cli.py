"""The verbs of the command line; what they do stands in `app`, `demo` and `report`."""

from __future__ import annotations

import json
import re
import sys
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, NoReturn

import typer

from observer.errors import UserError
from observer.fleet.cli import fleet
from observer.service.shutdown import leave

if TYPE_CHECKING:
    from rich.console import RenderableType

    from observer.publish.ask import Answer
    from observer.tables.publishing import Client

app = typer.Typer(
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
)
app.add_typer(fleet, name="fleet")
DEFAULT_ENDPOINT = "tcp/127.0.0.1:7447"

ConfigOption = Annotated[Path, typer.Option("--config", "-c", help="Configuration (TOML).")]
OutputOption = Annotated[
    Path, typer.Option("--output", "-o", help="Folder for the results; made if missing.")
]
SecondsOption = Annotated[float | None, typer.Option(min=0, help="Stop by itself after this many seconds.")]


def _version(asked: bool) -> None:
    """Say which version this is, and end."""
    if asked:
        from importlib.metadata import version

        typer.echo(f"ballscrew-observer {version('ballscrew-observer')}")
        raise typer.Exit


@app.callback()
def about(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Say which version this is.")
    ] = False,
) -> None:
    """A ball screw's temperature field, heat inputs and thermal error, live and from logs."""


def _endpoint(option: typer.CallbackParam, text: str) -> str:
    """Refuse what is no endpoint before anything is started."""
    from observer.tables.endpoints import checked_endpoint

    try:
        return checked_endpoint(text)
    except ValueError as error:
        raise UserError(f"{option.opts[0]}: {error}") from None


ConnectOption = Annotated[
    str, typer.Option(help="Zenoh endpoint of the service or its router.", callback=_endpoint)
]


def _name(option: typer.CallbackParam, text: str) -> str:
    """Refuse what cannot be the name of a machine or axis before anything is asked."""
    if not re.fullmatch(r"[A-Za-z0-9_.-]{1,64}|\*", text):
        raise UserError(f"{option.opts[0]}: {text!r} is no name; names are of letters, digits and _.-")
    return text


MachineOption = Annotated[str, typer.Option(help="Machine; * for whichever is there.", callback=_name)]
AxisOption = Annotated[str, typer.Option(help="Axis; * for whichever is there.", callback=_name)]
OneMachineOption = Annotated[str, typer.Option("--machine", help="Which machine.", callback=_name)]
OneAxisOption = Annotated[str, typer.Option("--axis", help="Which axis.", callback=_name)]
TimeoutOption = Annotated[float, typer.Option(min=0.1, help="How long to wait for an answer.")]
ClientOption = Annotated[
    Path | None, typer.Option("--client", help="Who asks: certificates and password (TOML).")
]
LogArgument = Annotated[
    Path, typer.Argument(help="Log (.csv, .csv.gz, .parquet) or CAN recording (.asc, .blf …).")
]
TruncatedOption = Annotated[bool, typer.Option(help="Drop a last row that was cut off.")]
DamagedOption = Annotated[bool, typer.Option(help="Drop rows whose checksum is wrong.")]
JsonOption = Annotated[bool, typer.Option("--json", help="For programs.")]
HashOption = Annotated[
    str | None, typer.Option(help="Hash of the configuration that is meant; else the one in force.")
]


@app.command()
def demo(
    seconds: SecondsOption = None,
    listen: Annotated[
        str, typer.Option(help="Where the demo's Zenoh router listens.", callback=_endpoint)
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
    leave(run_demo(seconds, listen, plain or not sys.stdout.isatty(), shown))


@app.command()
def run(
    config: Annotated[
        list[Path], typer.Option("--config", "-c", help="Configuration (TOML); given again, another axis.")
    ],
    seconds: SecondsOption = None,
    log_format: Annotated[Literal["text", "json"], typer.Option(help="How messages are written.")] = "text",
) -> None:
    """Run the daemon beside the CNC until SIGTERM or Ctrl-C; of several axes, a process for each."""
    if len(config) > 1:
        from observer.fleet.axes import serve_axes
        from observer.service.messages import configure

        configure(as_json=log_format == "json")
        leave(serve_axes(config, seconds, log_format))
    path = config[0]
    from observer.service.spare import import_sparingly

    import_sparingly()
    from observer.daemon import serve
    from observer.installation import load
    from observer.service.messages import configure

    configure(as_json=log_format == "json")
    try:
        serve(load(path), seconds, path)
    except UserError as error:
        _say(error)
        leave(2)  # threads of parts that had been started may hang at the interpreter's exit
    leave(0)


@app.command()
def replay(
    log: LogArgument,
    config: ConfigOption,
    output: OutputOption,
    format: Annotated[Literal["csv", "parquet"], typer.Option(help="Format of the estimates.")] = "csv",
    accept_truncated: TruncatedOption = False,
    accept_damaged: DamagedOption = False,
) -> None:
    """Run a recorded log through the same path as live: estimates, summary.json, overview.png."""
    from observer import app as parts
    from observer.installation import load
    from observer.report.progress import counting

    with counting("replay") as progress:
        summary = parts.replay(
            log,
            load(config),
            output,
            f".{format}",
            accept_truncated=accept_truncated,
            accept_damaged=accept_damaged,
            progress=progress,
        )
    if summary["start"] != "cold":
        typer.echo(f"start: {summary['start']}")
    quality = ", ".join(f"{n} {name}" for name, n in summary["quality"].items() if n)
    typer.echo(f"{summary['rows']} estimates over {summary['duration_s']:.6g} s: {quality}")
    for name, mean_W in summary["heat_mean_W"].items():
        typer.echo(f"  {name}: {'unknown' if mean_W is None else f'{mean_W:.2f} W'} on average")
    for reason, steps in summary["reasons"].items():
        typer.echo(f"not good in {steps} estimates: {reason}", err=True)
    _warn(summary["doubts"])
    _warn_of_paths(summary["nut_path"])
    typer.echo(f"written to {output}: estimates.{format}, summary.json, overview.png")


@app.command()
def forecast(
    log: LogArgument,
    config: ConfigOption,
    output: OutputOption,
    program: Annotated[
        Path | None,
        typer.Option(help="What runs next, a log of the input channels, repeated; else as the log ends."),
    ] = None,
    hours: Annotated[float | None, typer.Option(min=0.05, max=24.0, help="How far ahead.")] = None,
    accept_truncated: TruncatedOption = False,
    accept_damaged: DamagedOption = False,
) -> None:
    """Say what comes after a log: temperatures and thermal error with sigma, and when it has settled."""
    from observer import app as parts
    from observer.installation import load
    from observer.report.progress import counting

    with counting("forecast") as progress:
        lines = parts.forecast(
            log,
            load(config),
            output,
            program=program,
            hours=hours,
            accept_truncated=accept_truncated,
            accept_damaged=accept_damaged,
            progress=progress,
        )
    for line in lines:
        typer.echo(line)
    typer.echo(f"written to {output}: forecast.csv, forecast.json, forecast.png")


@app.command()
def identify(
    log: LogArgument,
    config: ConfigOption,
    output: OutputOption,
    method: Annotated[
        Literal["smoother", "tikhonov", "conjugate-gradient"], typer.Option(help="How the heats are found.")
    ] = "smoother",
    regularisation: Annotated[
        float | None,
        typer.Option(help="Weight of the prior, 1 as configured; else chosen by the method."),
    ] = None,
    parameter_choice: Annotated[
        Literal["discrepancy", "gcv", "l-curve", "ico"] | None,
        typer.Option(help="How tikhonov chooses that weight; gcv by default."),
    ] = None,
    order: Annotated[
        int | None,
        typer.Option(min=0, max=1, help="Prior: 0 each heat by itself, 1 heats that walk (default)."),
    ] = None,
    gradient: Annotated[
        Literal["adjoint", "central-differences"] | None,
        typer.Option(help="Of the conjugate gradients; adjoint by default."),
    ] = None,
    seed: Annotated[int, typer.Option(min=0, help="Seed of what is drawn at random.")] = 0,
    accept_truncated: TruncatedOption = False,
    accept_damaged: DamagedOption = False,
) -> None:
    """Find the heats over a whole log at once: heat.csv, summary.json, heat.png."""
    from observer import app as parts
    from observer.history.options import MethodOptions
    from observer.installation import load
    from observer.report.progress import saying

    options = MethodOptions(method, regularisation, parameter_choice, order, gradient, seed)
    with saying("identify") as progress:
        summary = parts.identify(
            log,
            load(config),
            output,
            options,
            accept_truncated=accept_truncated,
            accept_damaged=accept_damaged,
            progress=progress,
        )
    typer.echo(f"{summary['rows']} rows over {summary['duration_s']:.6g} s by {method}")
    for name, mean_W in summary["heat_mean_W"].items():
        sigma_W = summary["heat_sigma_mean_W"][name]
        typer.echo(f"  {name}: {mean_W:.2f} W on average, σ {sigma_W:.2f} W at a time")
    _warn([*summary["warnings"], *summary["doubts"]])
    _warn_of_paths(summary["nut_path"])
    typer.echo(f"written to {output}: heat.csv, summary.json, heat.png")


_REGIMES = {
    "points": "the position of {name} is sampled less than 2.5 times a traverse; its heat is spread over "
    "the sampled places of the last 20 s",
    "undetermined": "the position of {name} is sampled in step with its motion, so its path is not in the "
    "log; record it faster, at least ten samples a traverse",
}


def _warn(sentences: list[str]) -> None:
    for sentence in sentences:
        typer.echo(f"warning: {sentence}", err=True)


def _warn_of_paths(regimes: dict[str, str]) -> None:
    for name, regime in regimes.items():
        if regime != "path":
            typer.echo(f"warning: {_REGIMES[regime].format(name=name)}", err=True)


@app.command()
def simulate(
    config: ConfigOption,
    program: Annotated[Path, typer.Option(help="Log of the input channels (speed, position, power …).")],
    output: Annotated[Path, typer.Option("--output", "-o", help="Log to write: .csv, .csv.gz or .parquet.")],
    start_degC: Annotated[
        float | None,
        typer.Option(help="Screw temperature at the start; else by sensors or ambient."),
    ] = None,
) -> None:
    """Predict a run from the heat laws alone, as a log with overview.png beside it."""
    from observer import app as parts
    from observer.installation import load
    from observer.report.progress import counting

    settings, doubts = load(config), list[str]()
    with counting("simulate") as progress:
        last = parts.simulate(program, settings, output, start_degC, progress, doubts.extend)
    ends = ", ".join(f"{s.name} {t:.2f} °C" for s, t in zip(settings.sensor, last, strict=True))
    typer.echo(f"at the end: {ends}")
    _warn(doubts)
    typer.echo(f"written: {output}, {output.parent / 'overview.png'}")


@app.command()
def calibrate(
    log: Annotated[list[Path], typer.Argument(help="One or more logs of the same machine.")],
    config: ConfigOption,
    output: OutputOption,
) -> None:
    """Fit what the configuration declares free; write config.toml and calibration.json."""
    from observer import app as parts
    from observer.report.progress import saying

    with saying("calibrate") as progress:
        result = parts.calibrate(log, config, output, progress)
    for key, fitted in result["calibrated"].items():
        low, high = fitted["ci95"]
        typer.echo(f"{key} = {fitted['value']:g} ({low:g} … {high:g}), was {fitted['before']:g}")
    _warn([*result["not_told"], *result["doubts"]])
    for key, value in (result["left"] | result["process_noise"]).items():
        typer.echo(f"{key} = {value:g}")
    gap = result["gap"]
    typer.echo(f"open-loop gap {gap['before_rms_K']:g} K rms before, {gap['after_rms_K']:g} K after")
    typer.echo(f"written to {output}: config.toml, calibration.json")


@app.command()
def learned(config: ConfigOption, output: OutputOption) -> None:
    """Write the configuration with what its service has learnt, such as film and offsets."""
    from observer import app as parts

    for key, (value, sigma) in parts.learned(config, output).items():
        typer.echo(f"{key} = {value:.5g} ± {sigma:.2g}")
    typer.echo(f"written to {output}: config.toml, learned.json")


@app.command()
def discover(
    config: ConfigOption,
    output: OutputOption,
    log: Annotated[
        list[Path] | None,
        typer.Argument(help="Logs of the same machine; the last one, or its end, is kept as proof."),
    ] = None,
    recent: Annotated[
        str | None,
        typer.Option(help="In place of logs, what the service recorded in the last 90min, 8h, 2d …"),
    ] = None,
) -> None:
    """Find the physical effect that the model lacks; add it, and prove that the gap shrinks."""
    if bool(log) == (recent is not None):
        raise UserError(
            "discover: name either logs or --recent with a duration, as in --recent 8h, and not both"
        )
    from observer import app as parts
    from observer.report.progress import advancing
    from observer.report.wording import as_sentences
    from observer.service.recent import duration_s

    recent_s = None if recent is None else duration_s(recent)
    with advancing("discover") as progress:
        found, result = parts.discover(config, log or [], output, progress, recent_s=recent_s)
    if recent is not None:
        for name in result["logs"]:
            typer.echo(f"searched: {name}")
    _warn(result["doubts"])
    for sentence in as_sentences(found, result):
        typer.echo(sentence)
    files = "config.toml, result.json, report.html" if result["effects"] else "result.json, report.html"
    typer.echo(f"written to {output}: {files}")


@app.command()
def adopt(
    config: ConfigOption,
    folder: Annotated[
        Path | None, typer.Argument(metavar="DIR", help="What discover or calibrate has written.")
    ] = None,
    hours: Annotated[
        float, typer.Option(min=0.001, max=1000.0, help="Hours of running over which the gap is watched.")
    ] = 24.0,
    status: Annotated[
        bool, typer.Option("--status", help="Instead, say how the last adoption stands.")
    ] = False,
    undo: Annotated[bool, typer.Option("--undo", help="Instead, take the last adoption back.")] = False,
) -> None:
    """Put a found configuration in force, watch the gap, and take it back if that has not shrunk."""
    if [folder is not None, status, undo].count(True) != 1:
        raise UserError("adopt: name either the folder of results, or --status, or --undo")
    from observer import app as parts

    if folder is not None:
        typer.echo(parts.adopt(folder, config, hours))
    else:
        typer.echo(parts.adopted(config, undo=undo))


def _answer(words: str) -> Any:
    return typer.Option(help=words, show_default=False)


@app.command()
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


@app.command()
def check(
    config: ConfigOption,
    wires: Annotated[
        bool, typer.Option(help="Instead, read every device once; exit code 0 if every channel came.")
    ] = False,
    as_json: JsonOption = False,
) -> None:
    """Say what a configuration means: modes, observability, poles, noise gain, warnings."""
    from observer.report.check_text import as_text, wires_as_text
    from observer.report.examine import examine

    settings = examine(config)
    if wires:
        from observer import app as parts

        found = parts.wires(settings)
        _show(found, as_json, wires_as_text)
        leave(0 if found["good"] else 1)
    from observer.report.check import findings

    _show(findings(settings), as_json, as_text)


def _show(found: Any, as_json: bool, as_text: Callable[[Any], RenderableType]) -> None:
    """Print what was found, for programs or for people."""
    if as_json:
        typer.echo(json.dumps(found, indent=2, allow_nan=False))
        return
    from rich.console import Console

    Console(highlight=False).print(as_text(found))


@app.command()
def place(
    config: ConfigOption,
    sensors: Annotated[int, typer.Option(min=1, max=32, help="How many sensors to place.")],
    spacing_m: Annotated[float | None, typer.Option(min=1e-4, help="Spacing of the candidates.")] = None,
    as_json: JsonOption = False,
) -> None:
    """Rank sensor positions by how well they tell field and heats (conditioning, not rank)."""
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


@app.command()
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
    from observer.fleet.axes import check_axes

    check_axes(config or [])
    for line in parts.service(config or [], root, dry_run=dry_run):
        typer.echo(line)


@app.command()
def watch(
    connect: ConnectOption = DEFAULT_ENDPOINT,
    machine: MachineOption = "*",
    axis: AxisOption = "*",
    seconds: SecondsOption = None,
    client: ClientOption = None,
) -> None:
    """Subscribe to a running service and show heats, field and quality in the terminal."""
    from observer.view import watch as show

    leave(show(connect, machine, axis, seconds, _client(client)))


def _client(path: Path | None) -> Client | None:
    from observer.installation import load_client

    return None if path is None else load_client(path)


@app.command()
def health(
    connect: ConnectOption = DEFAULT_ENDPOINT,
    machine: MachineOption = "*",
    axis: AxisOption = "*",
    timeout_s: TimeoutOption = 5.0,
    client: ClientOption = None,
) -> None:
    """Ask the running service how it fares; exit code 0 if it lives and gives estimates, else 1."""
    from observer.publish.ask import ask_health, gives_estimates
    from observer.publish.watch import health_table

    answer = ask_health(connect, machine, axis, timeout_s, _client(client))
    _tell(answer, gives_estimates, health_table)


def _tell(
    answer: Answer,
    is_good: Callable[[dict[str, Any]], bool],
    for_people: Callable[[dict[str, Any]], RenderableType] = json.dumps,
) -> NoReturn:
    """Print what a service answered, in a terminal for people, and leave with 0 if that is good, else 1."""
    if answer.document is not None and sys.stdout.isatty():
        from rich.console import Console

        Console(highlight=False, markup=False).print(for_people(answer.document))
    else:
        typer.echo(answer.problem if answer.document is None else json.dumps(answer.document))
    leave(0 if answer.document is not None and is_good(answer.document) else 1)


_COMMANDS = {
    "arm": "Arm the compensation of one axis; exit code 0 if it is armed then, else 1.",
    "disarm": "Switch the compensation of one axis off; exit code 0 if it is off then, else 1.",
    "reset": "Have the estimator of one axis start afresh; exit code 0 if it does, else 1.",
}


def _giving(kind: str) -> Callable[..., None]:
    """The verb that gives a running service the command `kind` and prints what came of it."""

    def give(
        machine: OneMachineOption,
        axis: OneAxisOption,
        connect: ConnectOption = DEFAULT_ENDPOINT,
        timeout_s: TimeoutOption = 5.0,
        client: ClientOption = None,
        config_hash: HashOption = None,
    ) -> None:
        _give(kind, machine, axis, connect, timeout_s, client, config_hash)

    return give


def _give(
    kind: str,
    machine: str,
    axis: str,
    connect: str,
    timeout_s: float,
    client: Path | None,
    config_hash: str | None,
    about: str | None = None,
) -> None:
    """Give a running service a command and tell what came of it."""
    from observer.publish.ask import command

    for option, name in (("--machine", machine), ("--axis", axis)):
        if "*" in name:
            raise UserError(f"{option}: {name} may be several; name the one that is meant")
    answer = command(kind, connect, machine, axis, timeout_s, _client(client), config_hash, about)
    _tell(answer, lambda document: document.get("done") is True)


for _kind, _help in _COMMANDS.items():
    app.command(_kind, help=_help)(_giving(_kind))


@app.command()
def acknowledge(
    machine: OneMachineOption,
    axis: OneAxisOption,
    alarm: Annotated[str | None, typer.Argument(help="Its id; all of them if left out.")] = None,
    connect: ConnectOption = DEFAULT_ENDPOINT,
    timeout_s: TimeoutOption = 5.0,
    client: ClientOption = None,
    config_hash: HashOption = None,
) -> None:
    """Say that an alarm of one axis has been seen; exit code 0 if that is noted, else 1."""
    if alarm is not None and not re.fullmatch(r"[A-Za-z0-9_.-]{1,250}", alarm):
        raise UserError(f"{alarm!r} is no alarm; `observer watch` shows which there are")
    _give("acknowledge", machine, axis, connect, timeout_s, client, config_hash, alarm)


def main() -> None:
    """Run the command line; what a user can mend ends in one sentence and exit code 2."""
    try:
        app(prog_name="observer")
    except UserError as error:
        _say(error)
        sys.exit(2)
    except ModuleNotFoundError as error:
        from observer.installation.extras import remedy

        verb = next((word for word in sys.argv[1:] if not word.startswith("-")), "")
        sentence = remedy(f"observer {verb}", error)
        if sentence is None:
            raise
        _say(UserError(sentence))
        leave(2)  # a daemon may have started threads by then


def _say(error: UserError) -> None:
    sys.stdout.flush()
    print(f"observer: {error}", file=sys.stderr)
