"""The verbs that query or command a running service."""

from __future__ import annotations

import re
import time
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NoReturn

import typer

from observer.cli.options import (
    DEFAULT_ENDPOINT,
    AxisOption,
    ClientOption,
    ConnectOption,
    HashOption,
    JsonOption,
    MachineOption,
    SecondsOption,
    TimeoutOption,
)
from observer.errors import UserError
from observer.process import shutdown
from observer.process.terminal import echo, print_for_people, readable_json

if TYPE_CHECKING:
    from rich.console import RenderableType

    from observer.bus.ask import Address, Reply
    from observer.config.publishing import Client

verbs = typer.Typer()


@verbs.command()
def watch(
    connect: ConnectOption = DEFAULT_ENDPOINT,
    machine: MachineOption = "*",
    axis: AxisOption = "*",
    seconds: SecondsOption = None,
    client: ClientOption = None,
) -> None:
    """Subscribe to a running service and show heats, field and quality in the terminal."""
    from observer.bus.view import watch as show

    shutdown.leave(show(connect, machine, axis, seconds, _client(client)))


def _client(path: Path | None) -> Client | None:
    from observer.installation import load_client

    return None if path is None else load_client(path)


def _address(connect: str, machine: str, axis: str, client: Path | None) -> Address:
    from observer.bus.ask import Address

    return Address(connect, machine, axis, _client(client))


@verbs.command()
def health(
    connect: ConnectOption = DEFAULT_ENDPOINT,
    machine: MachineOption = "*",
    axis: AxisOption = "*",
    timeout_s: TimeoutOption = 5.0,
    client: ClientOption = None,
    as_json: JsonOption = False,
) -> None:
    """Show the health of the running service; exit code 0 if it gives estimates, else 1."""
    from observer.bus.ask import ask, ask_health, gives_estimates
    from observer.bus.watch import health_table

    address = _address(connect, machine, axis, client)
    answer = ask_health(address, timeout_s)

    def table(report: dict[str, Any]) -> RenderableType:
        machine, axis = answer.source
        alarms = ask(address._replace(machine=machine, axis=axis), "alarms", timeout_s)
        return health_table(report, alarms.document or {}, "/".join(answer.source), time.time())

    _print_answer(answer, gives_estimates, None if as_json else table)


def _print_answer(
    answer: Reply,
    is_good: Callable[[dict[str, Any]], bool],
    for_people: Callable[[dict[str, Any]], RenderableType] | None = None,
) -> NoReturn:
    """Print the answer of a service, for people or as JSON, and leave with 0 if that is good, else 1."""
    if answer.document is not None and for_people is not None:
        print_for_people(for_people(answer.document))
    else:
        echo(answer.problem if answer.document is None else readable_json(answer.document))
    shutdown.leave(0 if answer.document is not None and is_good(answer.document) else 1)


_COMMANDS = {
    "disarm": "Switch the compensation of one axis off; exit code 0 if it is then off, else 1.",
    "zero": "Report that one axis has just been homed or probed, so that its compensation starts from a "
    "new zero; exit code 0 if it does, else 1.",
    "reset": "Restart the estimator of one axis; exit code 0 if it does, else 1.",
}


def _command_verb(kind: str) -> Callable[..., None]:
    """The verb that gives a running service the command `kind` and prints the outcome."""

    def give(
        connect: ConnectOption = DEFAULT_ENDPOINT,
        machine: MachineOption = "*",
        axis: AxisOption = "*",
        timeout_s: TimeoutOption = 5.0,
        client: ClientOption = None,
        config_hash: HashOption = None,
    ) -> None:
        _give(kind, _address(connect, machine, axis, client), timeout_s, config_hash)

    return give


def _give(
    kind: str,
    address: Address,
    timeout_s: float,
    config_hash: str | None,
    parameters: dict[str, str] | None = None,
) -> None:
    """Give a running service a command and print the outcome."""
    from observer.bus.ask import command

    answer = command(kind, address, timeout_s, config_hash, parameters)
    _print_answer(answer, lambda document: document.get("done") is True)


for _kind, _help in _COMMANDS.items():
    verbs.command(_kind, help=_help)(_command_verb(_kind))


@verbs.command()
def arm(
    connect: ConnectOption = DEFAULT_ENDPOINT,
    machine: MachineOption = "*",
    axis: AxisOption = "*",
    without: Annotated[
        list[str] | None, typer.Option(help="A sensor that may be excluded or missing; can be repeated.")
    ] = None,
    timeout_s: TimeoutOption = 5.0,
    client: ClientOption = None,
    config_hash: HashOption = None,
) -> None:
    """Arm the compensation of one axis; exit code 0 if it is then armed and its control follows, else 1."""
    names = [name for text in without or () for name in text.split(",")]
    if strange := [name for name in names if not re.fullmatch(r"[A-Za-z0-9_.-]{1,64}", name)]:
        raise UserError(
            f"--without: {strange[0]!r} is not the name of a sensor; names consist of letters, digits and _.-"
        )
    parameters = {"without": ",".join(names)} if names else None
    _give("arm", _address(connect, machine, axis, client), timeout_s, config_hash, parameters)


@verbs.command()
def acknowledge(
    alarm: Annotated[str | None, typer.Argument(help="Its id; all of them if left out.")] = None,
    connect: ConnectOption = DEFAULT_ENDPOINT,
    machine: MachineOption = "*",
    axis: AxisOption = "*",
    timeout_s: TimeoutOption = 5.0,
    client: ClientOption = None,
    config_hash: HashOption = None,
) -> None:
    """Acknowledge an alarm of one axis; exit code 0 if that is noted, else 1."""
    if alarm is not None and not re.fullmatch(r"[A-Za-z0-9_.-]{1,250}", alarm):
        raise UserError(f"{alarm!r} is not an alarm; `observer watch` lists them")
    parameters = None if alarm is None else {"id": alarm}
    _give("acknowledge", _address(connect, machine, axis, client), timeout_s, config_hash, parameters)
