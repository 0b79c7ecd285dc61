"""Files that would slow the checks or command the terminal are rejected or shown in plain characters."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest
from rich.live import Live
from rich.table import Table
from rich.text import Text

from observer.bus import view
from observer.cli.output import advancing
from observer.errors import ConfigError
from observer.files.regular import MOST_DEPTH, MOST_ENTRIES, read_toml
from observer.installation import load
from observer.installation.examine import examine
from observer.process.terminal import print_for_people, printable

CONFIG = Path(__file__).parents[2] / "config" / "demo.toml"
COMMANDS = "\x1b[31mred", "\x9b2J", "\x1b]0;owned\x07", "\u202egnp.exe", "\u2066x\u2069", "\rgood"


def assert_shown_as_escapes(shown: str) -> None:
    assert not any(sign in shown for sign in "\x1b\x9b\x07\r\u202e\u2066\u2069")
    assert "\\u202e" in shown


@pytest.mark.parametrize("key", ["a", '"b c"', "'d'"])
@pytest.mark.parametrize("line", ["{} = 1", "[{}]", "[[{}]]", "x = {{ y = 1, {} = 1 }}"])
def test_a_key_of_too_many_parts_is_rejected_before_it_is_parsed(
    key: str, line: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("tomllib.loads", lambda _text: pytest.fail("it was parsed"))
    path = tmp_path / "machine.toml"
    path.write_text(line.format(".".join([key] * 100_000)) + "\n")
    with pytest.raises(ConfigError, match=f"more than {MOST_DEPTH} nested tables"):
        read_toml(path)


def test_numbers_and_sentences_with_many_points_are_no_long_key(tmp_path: Path) -> None:
    path = tmp_path / "machine.toml"
    path.write_text(f"x_m = [{', '.join(['0.5'] * 1000)}]\n# {'a. ' * 1000}\ny = '{'b. ' * 1000}'\n")
    assert len(read_toml(path)["x_m"]) == 1000


@pytest.mark.parametrize(
    ("keys", "words"),
    [(MOST_ENTRIES + 1, f"more than {MOST_ENTRIES} keys"), (5000, r"and \d+ more; fix these first")],
)
def test_a_file_of_too_many_keys_is_rejected_with_few_suggestions(
    keys: int, words: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    suggested = []
    monkeypatch.setattr("observer.installation.problems._closest", lambda key, _: suggested.append(key))
    path = tmp_path / "machine.toml"
    path.write_text("".join(f"k{i} = 1\n" for i in range(keys)))
    with pytest.raises(ConfigError, match=words):
        load(path)
    assert len(suggested) <= 40


@pytest.mark.parametrize("table", ["record", "checkpoint"])
@pytest.mark.parametrize("directory", [r"a\u0000b", "x" * 5000], ids=["NUL", "too long"])
def test_a_directory_that_no_file_system_can_have_is_rejected(
    table: str, directory: str, tmp_path: Path
) -> None:
    path = tmp_path / "machine.toml"
    path.write_text(f'{CONFIG.read_text()}\n[{table}]\ndirectory = "{directory}"\n')
    with pytest.raises(ConfigError, match=rf"{table}\.directory: .* is no path of a file; fix it"):
        load(path)


def test_a_configuration_that_is_not_a_file_is_neither_waited_for_nor_read(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    for path in (tmp_path / "pipe", Path("/dev/zero"), tmp_path, tmp_path / ("x" * 300)):
        with pytest.raises(ConfigError, match="cannot be read"):
            examine(path)


def test_a_configuration_without_end_is_not_read_to_its_end(tmp_path: Path) -> None:
    path = tmp_path / "large.toml"
    with path.open("wb") as file:
        file.truncate(50_000_000_000)
    with pytest.raises(ConfigError, match="larger than 4 MB"):
        examine(path)


def test_a_path_that_commands_a_terminal_is_printed_as_escapes(tmp_path: Path) -> None:
    path = tmp_path / "".join(COMMANDS) / "machine.toml"
    command = [sys.executable, "-m", "observer", "check", "--config", str(path)]
    done = subprocess.run(command, capture_output=True, check=False)
    assert done.returncode == 2
    assert "no such file" in done.stderr.decode()
    assert_shown_as_escapes(done.stderr.decode())
    assert printable("Spindel über 20 °C, 5 µm\n") == "Spindel über 20 °C, 5 µm\n"


def in_a_table() -> None:
    table = Table("name")
    for command in COMMANDS:
        table.add_row(Text(command))
    print_for_people(table)


def in_the_live_view() -> None:
    with Live(Text("".join(COMMANDS)), console=view.printable_console()):
        pass


@pytest.mark.parametrize("show", [in_a_table, in_the_live_view])
def test_a_name_that_commands_a_terminal_is_shown_as_escapes(show, capsys) -> None:
    show()
    assert_shown_as_escapes(capsys.readouterr().out)


def test_a_progress_bar_shows_neither_commands_nor_markup_of_a_name(capsys, monkeypatch) -> None:
    monkeypatch.setenv("FORCE_COLOR", "1")  # rich takes the stream for a terminal
    with advancing("compare") as progress:
        progress("\u202e\x9b[bold]x[/]", 0.5)
    shown = capsys.readouterr().err
    assert not any(sign in shown for sign in "\x9b\u202e")
    assert "\\u202e" in shown
    assert "[bold]" in shown
