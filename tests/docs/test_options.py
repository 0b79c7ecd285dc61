"""The page about commands lists every command and option of the program, and nothing else."""

from __future__ import annotations

import re
from pathlib import Path

import typer

from observer.cli import app

PAGE = (Path(__file__).parents[2] / "docs" / "reference" / "commands.md").read_text(encoding="utf-8")
COMMANDS = getattr(typer.main.get_command(app), "commands")  # noqa: B009 - typer types it as a plain command


def test_every_command_has_its_line() -> None:
    assert set(re.findall(r"^\| `observer (\w+)", PAGE, flags=re.M)) == set(COMMANDS)


def test_every_option_has_its_line() -> None:
    documented = {
        (command, option)
        for options, of in re.findall(r"^\| ((?:`--[\w-]+`(?:, )?)+) \| (.*?) \|", PAGE, flags=re.M)
        for option in re.findall(r"`(--[\w-]+)`", options)
        for command in re.findall(r"`(\w+)`", of)
    }
    coded = {
        (name, max(parameter.opts, key=len))
        for name, command in COMMANDS.items()
        for parameter in command.params
        if parameter.opts[0].startswith("-")
    }
    assert documented == coded
