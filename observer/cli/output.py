"""What verbs print for people: warnings, tables, and the sentence at which they end."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import typer

from observer.errors import UserError

if TYPE_CHECKING:
    from rich.console import RenderableType


_REGIMES = {
    "points": "the position of {name} is sampled less than 2.5 times a traverse; its heat is spread over "
    "the sampled places of the last 20 s",
    "undetermined": "the position of {name} is sampled in step with its motion, so its path is not in the "
    "log; record it faster, at least ten samples a traverse",
}


def say(error: UserError) -> None:
    """Print the sentence at which a command ends."""
    sys.stdout.flush()
    print(f"observer: {error}", file=sys.stderr)


def warn(sentences: list[str]) -> None:
    """Print what is doubtful about a result."""
    for sentence in sentences:
        typer.echo(f"warning: {sentence}", err=True)


def warn_of_paths(regimes: dict[str, str]) -> None:
    """Print of which nuts the path is not in the log."""
    for name, regime in regimes.items():
        if regime != "path":
            typer.echo(f"warning: {_REGIMES[regime].format(name=name)}", err=True)


def show(found: Any, as_json: bool, as_text: Callable[[Any], RenderableType]) -> None:
    """Print what was found, for programs or for people."""
    if as_json:
        typer.echo(json.dumps(found, indent=2, allow_nan=False))
        return
    from rich.console import Console

    Console(highlight=False).print(as_text(found))
