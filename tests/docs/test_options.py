"""The page about commands lists every command and option of the program, and nothing else."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import typer

from observer.cli import app

PAGE = (Path(__file__).parents[2] / "docs" / "reference" / "commands.md").read_text(encoding="utf-8")


def _commands(of: Any, before: str = "") -> dict[str, Any]:
    """Every command by its name; those of a group by both names."""
    found = {}
    for name, command in of.commands.items():
        nested = hasattr(command, "commands")
        found |= _commands(command, f"{before}{name} ") if nested else {f"{before}{name}": command}
    return found


COMMANDS = _commands(typer.main.get_command(app))


def test_every_command_has_its_line() -> None:
    assert set(re.findall(r"^\| `observer ((?:fleet )?\w+)", PAGE, flags=re.M)) == set(COMMANDS)


def _named(of: str) -> list[str]:
    """The commands that a heading or a cell names; `fleet …` are all of the group."""
    fleet = [name for name in COMMANDS if name.startswith("fleet ")]
    return [c for name in re.findall(r"`([\w …]+)`", of) for c in (fleet if name == "fleet …" else [name])]


def test_every_option_has_its_line() -> None:
    documented = {
        (command, option)
        for section in PAGE.split("\n## ")[1:]
        for options, of in re.findall(r"^\| ((?:`--[\w-]+`(?:, )?)+) \| (.*?) \|", section, flags=re.M)
        for option in re.findall(r"`(--[\w-]+)`", options)
        for command in _named(of if "| option | of |" in section else section.split("\n", 1)[0])
    }
    coded = {
        (name, max(parameter.opts, key=len))
        for name, command in COMMANDS.items()
        for parameter in command.params
        if parameter.opts[0].startswith("-")
    }
    assert documented == coded
