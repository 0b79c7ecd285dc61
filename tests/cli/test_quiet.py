"""`--quiet`, and the phases that a bar names."""

from __future__ import annotations

import io
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from rich.console import Console
from typer.testing import CliRunner

from observer.cli import app, output
from tests.installation.test_init import GIVEN

OPTIONS = [part for name, value in GIVEN.items() for part in (f"--{name.replace('_', '-')}", value)]


def test_a_quiet_verb_prints_nothing_and_does_its_work(tmp_path: Path) -> None:
    file = tmp_path / "observer.toml"
    done = CliRunner().invoke(app, ["init", "--quiet", "--output", str(file), *OPTIONS])
    assert (done.exit_code, done.output) == (0, "")
    assert file.exists()
    again = CliRunner().invoke(app, ["init", "--quiet", "--output", str(file), *OPTIONS])
    assert "not overwritten" in str(again.exception)
    loud = CliRunner().invoke(app, ["init", "--output", str(tmp_path / "other.toml"), *OPTIONS])
    assert loud.output.startswith("written: ")


def test_a_bar_names_its_phase_and_is_absent_when_quiet(monkeypatch: pytest.MonkeyPatch) -> None:
    drawn = io.StringIO()

    class Watched(Console):
        def __init__(self, **_: Any) -> None:
            super().__init__(file=drawn, force_terminal=True, width=100)

    monkeypatch.setattr("rich.console.Console", Watched)
    with output.counting("replay", "estimating", "writing") as progress:
        progress(1, 2)
        progress(2, 2)
    with output.advancing("discover") as advance:
        advance("round 1 of candidates", 0.3)
    for words in ("replay: writing", "discover: round 1 of candidates"):
        assert words in drawn.getvalue()
    before = len(drawn.getvalue())
    with output.silent(), output.counting("replay", "estimating", "writing") as progress:
        progress(1, 2)
    assert len(drawn.getvalue()) == before


def test_sentences_are_wrapped_between_words_in_a_terminal_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    class Terminal(io.StringIO):
        def isatty(self) -> bool:
            return True

    monkeypatch.setenv("COLUMNS", "40")
    sentence = "  on data held back the gap goes from 2.29 K to 0.11 K rms-free"
    for stream, lines in ((Terminal(), 2), (io.StringIO(), 1)):
        monkeypatch.setattr(sys, "stdout", stream)
        output.show_sentence(sentence)
        shown = stream.getvalue().splitlines()
        assert len(shown) == lines
        assert max(map(len, shown)) <= 40 or lines == 1
        assert " ".join("".join(f"{line} " for line in shown).split()) == " ".join(sentence.split())


@pytest.mark.system
def test_bash_completes_verbs_and_options(tmp_path: Path) -> None:
    program = tmp_path / "observer"
    program.write_text(f'#!/bin/sh\nexec "{sys.executable}" -m observer "$@"\n')
    program.chmod(0o755)
    script = """
        eval "$(observer --show-completion bash)"
        complete -p observer >/dev/null
        for words in "observer dis" "observer check --wi" "observer fleet rep"; do
            COMP_WORDS=($words); COMP_CWORD=$(( ${#COMP_WORDS[@]} - 1 ))
            $(complete -p observer | sed 's/.*-F \\([^ ]*\\).*/\\1/') observer
            echo "${COMPREPLY[*]}"
        done
    """
    environment = os.environ | {"PATH": f"{tmp_path}:{os.environ['PATH']}", "SHELL": "/bin/bash"}
    done = subprocess.run(
        ["bash", "-c", script], env=environment, capture_output=True, text=True, check=False
    )
    assert done.stdout.split("\n")[:3] == ["discover disarm", "--wires", "replay"], done.stderr
