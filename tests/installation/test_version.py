"""The version that the program says is that of the project."""

from __future__ import annotations

import tomllib
from pathlib import Path

from typer.testing import CliRunner

from observer.cli import app


def test_the_program_says_which_version_it_is():
    project = tomllib.loads((Path(__file__).parents[2] / "pyproject.toml").read_text())["project"]
    said = CliRunner().invoke(app, ["--version"])
    assert said.exit_code == 0
    assert said.output == f"ballscrew-observer {project['version']}\n"
