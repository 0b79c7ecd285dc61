"""Files that would slow the checks or command the terminal are refused or shown in plain characters."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from observer.errors import ConfigError
from observer.files.regular import MOST_DEPTH, MOST_ENTRIES, read_toml
from observer.installation import load
from observer.terminal import printable

CONFIG = Path(__file__).parents[2] / "config" / "demo.toml"
COMMANDS = {
    "escape": "\x1b[31mred", "sequence": "\x9b2J", "title": "\x1b]0;owned\x07", "bell": "\x07",
    "override": "\u202egnp.exe", "isolate": "\u2066x\u2069", "return": "\rgood",
}  # fmt: skip


@pytest.mark.parametrize("key", ["a", '"b c"', "'d'"])
@pytest.mark.parametrize("line", ["{} = 1", "[{}]", "[[{}]]", "x = {{ y = 1, {} = 1 }}"])
def test_a_key_of_too_many_parts_is_refused_before_it_is_parsed(
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


def test_a_file_of_too_many_keys_is_refused_as_a_whole(tmp_path: Path) -> None:
    path = tmp_path / "machine.toml"
    path.write_text("".join(f"k{i} = 1\n" for i in range(MOST_ENTRIES + 1)))
    with pytest.raises(ConfigError, match=f"more than {MOST_ENTRIES} keys"):
        load(path)


def test_names_are_suggested_for_the_listed_keys_alone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked = []
    monkeypatch.setattr("observer.installation.problems._closest", lambda key, _known: asked.append(key))
    path = tmp_path / "machine.toml"
    path.write_text("".join(f"k{i} = 1\n" for i in range(5000)))
    with pytest.raises(ConfigError, match=r"and \d+ more; fix these first"):
        load(path)
    assert len(asked) <= 40


@pytest.mark.parametrize("table", ["record", "checkpoint"])
@pytest.mark.parametrize("directory", [r"a\u0000b", "x" * 5000], ids=["NUL", "too long"])
def test_a_directory_that_no_file_system_can_have_is_refused(
    table: str, directory: str, tmp_path: Path
) -> None:
    path = tmp_path / "machine.toml"
    path.write_text(f'{CONFIG.read_text()}\n[{table}]\ndirectory = "{directory}"\n')
    with pytest.raises(ConfigError, match=rf"{table}\.directory: .* is no path of a file; fix it"):
        load(path)


@pytest.mark.parametrize("command", COMMANDS.values(), ids=COMMANDS)
def test_a_name_that_commands_a_terminal_is_printed_as_escapes(command: str, tmp_path: Path) -> None:
    folder = tmp_path / f"log{command.replace('/', '')}"
    done = subprocess.run(
        [sys.executable, "-m", "observer", "check", "--config", str(folder / "machine.toml")],
        capture_output=True, check=False,
    )  # fmt: skip
    assert done.returncode == 2
    shown = done.stderr.decode()
    assert "no such file" in shown
    assert not any(sign in shown for sign in "\x1b\x9b\x07\r\u202e\u2066\u2069")
    assert printable("Spindel über 20 °C, 5 µm\n") == "Spindel über 20 °C, 5 µm\n"


def test_a_table_shows_no_command_from_a_file(capsys: pytest.CaptureFixture[str]) -> None:
    from rich.table import Table
    from rich.text import Text

    from observer.terminal import print_for_people

    table = Table("name")
    for command in COMMANDS.values():
        table.add_row(Text(command))
    print_for_people(table)
    shown = capsys.readouterr().out
    assert not any(sign in shown for sign in "\x1b\x9b\x07\r\u202e\u2066\u2069")


def test_a_bar_shows_no_command_from_a_file(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    from observer.cli.output import advancing

    monkeypatch.setenv("FORCE_COLOR", "1")  # rich takes the stream for a terminal
    with advancing("compare") as progress:
        progress("\u202e\x9b[bold]x[/]", 0.5)
    shown = capsys.readouterr().err
    assert not any(sign in shown for sign in "\x9b\u202e")
    assert "\\u202e" in shown
    assert "[bold]" in shown


def test_the_live_view_shows_no_command_from_a_name(capsys: pytest.CaptureFixture[str]) -> None:
    from rich.live import Live
    from rich.text import Text

    from observer import view

    assert view.printable_console.__module__ == "observer.terminal"
    with Live(Text("\u202e\x9bx"), console=view.printable_console()):
        pass
    shown = capsys.readouterr().out
    assert not any(sign in shown for sign in "\x9b\u202e")
    assert "\\u202e" in shown
