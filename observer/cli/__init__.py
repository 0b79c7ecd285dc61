"""The command line; the work of its verbs is in `library`, `demo` and `report`.

A verb's docstring is its text in `--help`. Verbs import what they need when they run, so that the command
starts quickly.
"""

from __future__ import annotations

import signal
import sys
from typing import Annotated, NoReturn

import typer

from observer.cli import clients, intake, logs, machines
from observer.cli.fleet import fleet
from observer.cli.options import quietable
from observer.cli.output import print_error
from observer.errors import UserError
from observer.process import shutdown

app = typer.Typer(
    no_args_is_help=True,
    pretty_exceptions_enable=False,
)
_SHOWING = {"demo", "import", "outlets", "run", "check", "place"}
"""The verbs whose purpose is their output, like all clients; the others can be quiet."""
for _verbs in (machines.verbs, logs.verbs, fleet):
    for _info in _verbs.registered_commands:
        if _info.callback is not None and (_info.name or _info.callback.__name__) not in _SHOWING:
            _info.callback = quietable(_info.callback)
for _verbs in (machines.verbs, logs.verbs, intake.verbs, clients.verbs):
    app.add_typer(_verbs)
app.add_typer(fleet, name="fleet")


def _version(requested: bool) -> None:
    """Print the version, and end."""
    if requested:
        from importlib.metadata import version

        typer.echo(f"ballscrew-observer {version('ballscrew-observer')}")
        raise typer.Exit


@app.callback()
def root(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Show the version.")
    ] = False,
) -> None:
    """A ball screw's temperature field, heat inputs and thermal error, live and from logs."""


_INTERRUPTED = 130


def main() -> None:
    """Run the command line.

    Exit codes: 0 where all is well, 1 where a verb says so, 2 after a problem that the user can fix, 130
    after Ctrl-C. Such a problem is one sentence on standard error. A traceback appears for a defect only.
    """
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, shutdown.arriving(shutdown.interrupting()))
    try:
        app(prog_name="observer")
    except KeyboardInterrupt:  # before a command began
        _leave()
    except SystemExit as end:
        if end.code == _INTERRUPTED:
            _leave()
        raise
    except UserError as error:
        print_error(error)
        sys.exit(2)
    except Exception as error:
        sentence = _sentence(error)
        if sentence is None:
            raise
        print_error(UserError(sentence))
        shutdown.leave(2)  # a daemon may have started threads by then


def _sentence(error: Exception) -> str | None:
    """Say what the user can do about a missing package or a class from outside; None for a defect."""
    from observer.config.outside import fault_outside
    from observer.errors import install_remedy

    verb = next((word for word in sys.argv[1:] if not word.startswith("-")), "")
    missing = isinstance(error, ModuleNotFoundError) and install_remedy(f"observer {verb}", error)
    return missing or fault_outside(error)


def _leave() -> NoReturn:
    """End after Ctrl-C, without waiting for threads that are still busy."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    shutdown.leave(_INTERRUPTED)
