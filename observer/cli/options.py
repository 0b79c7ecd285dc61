"""The options that several verbs share."""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Iterable
from contextlib import nullcontext
from functools import wraps
from inspect import Parameter, signature
from pathlib import Path
from typing import Annotated, Any, get_type_hints

import typer

from observer.cli.output import silent
from observer.errors import UserError


def with_parameters(
    verb: Callable[..., None], extra: Iterable[Parameter] = (), without: Collection[str] = ("answers",)
) -> Callable[..., None]:
    """Return a verb whose signature, which typer reads, has other options; the function itself is changed.

    Args:
        verb: The function.
        extra: Options to add.
        without: Parameters to leave out.
    """
    verb_signature = signature(verb, eval_str=True)
    options = [option for name, option in verb_signature.parameters.items() if name not in without]
    verb.__signature__ = verb_signature.replace(parameters=[*options, *extra])  # type: ignore[attr-defined]
    return verb


def flattened(verb: Callable[..., None]) -> Callable[..., None]:
    """Return a verb with an option for each field of those of its parameters that are NamedTuples."""
    verb_signature = signature(verb, eval_str=True)
    kinds = {
        n: p.annotation for n, p in verb_signature.parameters.items() if hasattr(p.annotation, "_fields")
    }

    @wraps(verb)
    def run(**arguments: Any) -> None:
        records = {
            name: kind(**{f: arguments.pop(f) for f in kind._fields if f in arguments})
            for name, kind in kinds.items()
        }
        verb(**arguments, **records)

    options: list[Parameter] = []
    for name, option in verb_signature.parameters.items():
        options += _of_fields(kinds[name]) if name in kinds else [_by_name(option)]
    run.__signature__ = verb_signature.replace(parameters=options)  # type: ignore[attr-defined]
    return run


def _of_fields(kind: Any) -> list[Parameter]:
    """Return the fields of a NamedTuple as options."""
    hints, usual = get_type_hints(kind, include_extras=True), kind._field_defaults
    return [Parameter(f, Parameter.KEYWORD_ONLY, default=usual[f], annotation=hints[f]) for f in kind._fields]


def _by_name(option: Parameter) -> Parameter:
    """Return a parameter that is passed by its name, so that those with and without defaults may mix."""
    is_rest = option.kind is Parameter.VAR_KEYWORD
    return option if is_rest else option.replace(kind=Parameter.KEYWORD_ONLY)


DEFAULT_ENDPOINT = "tcp/127.0.0.1:7447"


ConfigOption = Annotated[Path, typer.Option("--config", "-c", help="Configuration (TOML).")]
OutputOption = Annotated[
    Path, typer.Option("--output", "-o", help="Folder for the results; made if missing.")
]
SecondsOption = Annotated[
    float | None, typer.Option(min=0, help="Stop after this many seconds; default: no limit.")
]


def endpoint(option: typer.CallbackParam, text: str) -> str:
    """Return an endpoint unchanged, before anything is started.

    Raises:
        UserError: It is not a Zenoh endpoint; the sentence names the option.
    """
    from observer.config.publishing import checked_endpoint

    try:
        return checked_endpoint(text)
    except ValueError as error:
        raise UserError(f"{option.opts[0]}: {error}") from None


ConnectOption = Annotated[
    str, typer.Option(help="Zenoh endpoint of the service or its router.", callback=endpoint)
]


def picture(path: Path | None) -> None:
    """Check the name of a picture before anything is computed.

    Raises:
        UserError: Its suffix is not .png, .svg or .pdf.
    """
    if path is not None and path.suffix not in (".png", ".svg", ".pdf"):
        raise UserError(f"--plot: {path}: give the name of a picture, ending in .png, .svg or .pdf")


def _name(option: typer.CallbackParam, text: str) -> str:
    """Reject an invalid name of a machine or axis before anything is asked."""
    if not re.fullmatch(r"[A-Za-z0-9_.-]{1,64}|\*", text):
        raise UserError(
            f"{option.opts[0]}: {text!r} is not a valid name; names consist of letters, digits and _.-"
        )
    return text


MachineOption = Annotated[str, typer.Option(help="Machine; * for the one that answers.", callback=_name)]
AxisOption = Annotated[str, typer.Option(help="Axis; * for the one that answers.", callback=_name)]
TimeoutOption = Annotated[float, typer.Option(min=0.1, help="Seconds to wait for an answer.")]
ClientOption = Annotated[
    Path | None, typer.Option("--client", help="Client credentials: certificates and password (TOML).")
]
LogArgument = Annotated[
    Path, typer.Argument(help="Log (.csv, .csv.gz, .parquet) or CAN recording (.asc, .blf …).")
]
JsonOption = Annotated[bool, typer.Option("--json", help="Print JSON, for programs.")]
HashOption = Annotated[
    str | None, typer.Option(help="Hash of the configuration meant; default: the one in force.")
]


def assignments(texts: Iterable[str]) -> dict[str, float]:
    """Return `name=value` options as numbers by name; a repeated name takes its last value.

    Raises:
        UserError: A text has another form, or its value is not a number.
    """
    values: dict[str, float] = {}
    for text in texts:
        name, _, value = text.partition("=")
        try:
            values[name.strip()] = float(value)
        except ValueError:
            raise UserError(
                f"--at {text}: give a channel and its value, such as --at speed_rpm=500"
            ) from None
    return values


def _flag(name: str, option: str, words: str) -> Parameter:
    """A parameter that is off unless its option is given."""
    annotation = Annotated[bool, typer.Option(option, help=words)]
    return Parameter(name, Parameter.KEYWORD_ONLY, default=False, annotation=annotation)


def quietable(verb: Callable[..., None]) -> Callable[..., None]:
    """Return a verb with the option `--quiet`, which prints nothing but warnings and errors."""

    @wraps(verb)
    def run(*, quiet: bool, **arguments: Any) -> None:
        with silent() if quiet else nullcontext():
            verb(**arguments)

    quiet_option = _flag("quiet", "--quiet", "Print nothing but warnings and errors.")
    return with_parameters(run, [quiet_option], without=())


def accepting(verb: Callable[..., None]) -> Callable[..., None]:
    """Return a verb that passes `**accept` to the reader of logs, with the options `--accept-…` for it."""
    options = {
        "accept_truncated": "Drop a last row that was cut off.",
        "accept_damaged": "Drop rows whose checksum is wrong.",
    }
    parameters = [_flag(name, f"--{name.replace('_', '-')}", words) for name, words in options.items()]
    return with_parameters(verb, parameters, without=("accept",))
