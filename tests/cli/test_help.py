"""Help on a terminal of 80 columns: nothing is cut, and every option says what it means and its default."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Any

import pytest
import typer
from typer.testing import CliRunner

from observer.cli import _SHOWING, app, clients

UNITS = {"s": "econds", "m": " m", "GB": "GB", "degC": "°C", "hours": "our"}
"""By the end of an option's name, what its help must say."""


ASKING = {info.name or info.callback.__name__ for info in clients.verbs.registered_commands}  # type: ignore[union-attr]
"""The verbs that ask a service."""


def walk(command: Any, path: tuple[str, ...] = ()) -> Iterator[tuple[tuple[str, ...], Any]]:
    yield path, command
    for name, below in getattr(command, "commands", {}).items():
        yield from walk(below, (*path, name))


EVERY = dict(walk(typer.main.get_command(app)))


def shown(path: tuple[str, ...]) -> str:
    done = CliRunner().invoke(
        app, [*path, "--help"], env={"COLUMNS": "80", "TERMINAL_WIDTH": "80", "TERM": "dumb"}
    )
    assert done.exit_code == 0, done.output
    return done.output


@pytest.mark.parametrize("path", EVERY, ids=" ".join)
def test_no_line_is_cut_and_no_word_broken(path: tuple[str, ...]) -> None:
    text = shown(path)
    assert max(map(len, text.splitlines())) <= 80
    words = {word for line in text.splitlines() for word in line.strip("│╭╰─╮╯ ").split()}
    texts = [EVERY[path].help or ""]
    texts += [p.help or "" for p in EVERY[path].params]
    texts += [below.help or "" for below in getattr(EVERY[path], "commands", {}).values()]
    expected = {word for sentence in texts for word in sentence.split()}
    expected |= {option for p in EVERY[path].params for option in p.opts if option.startswith("--")}
    assert expected - words == set()


@pytest.mark.parametrize("path", [p for p in EVERY if not hasattr(EVERY[p], "commands")], ids=" ".join)
def test_every_option_says_its_unit_and_what_holds_without_it(path: tuple[str, ...]) -> None:
    for option in EVERY[path].params:
        assert option.help, option.opts
        name = option.opts[0].lstrip("-")
        unit = UNITS.get(re.split("[-_]", name)[-1]) or UNITS.get(name)
        if unit and path != ("init",):  # which takes them with the unit
            assert unit in option.help, option.opts
        if (
            option.type_descriptor.annotation in (float, int)
            and option.default is None
            and not option.required
        ):
            assert re.search("else|default", option.help, re.IGNORECASE), option.opts


def test_every_verb_that_prints_can_be_quiet() -> None:
    for path, command in EVERY.items():
        quiet = "--quiet" in {option for p in command.params for option in p.opts}
        shows = not path or hasattr(command, "commands") or path[-1] in _SHOWING | ASKING
        assert quiet == (not shows), path
