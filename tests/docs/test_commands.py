"""Every command that the README and the documentation show is run, in order, page by page."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tests.docs.console import bounded, commands, matches, without_progress
from tests.patience import PATIENCE_S

ROOT = Path(__file__).parents[2]
PAGES = [
    p for p in [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))] if p.exists() and commands(p)
]
# What a reader has in the directory where the commands are typed.
COPIED = ("config", "tests/data", "docs/examples", "Makefile")
# What `make` compares with the environment; the stamps say that it was made from these.
SOURCES = ("requirements.lock", "requirements-build.lock", "pyproject.toml", "build_kernels.py")
STAMPS = ("build/uv/bin/uv", ".venv/requirements.lock.synced", ".venv/.runs")


def _name(page: Path) -> str:
    return str(page.relative_to(ROOT))


@pytest.fixture
def workplace(tmp_path: Path) -> Path:
    """A directory like a fresh checkout's top after `make runtime`.

    This interpreter is its `python`, this tree its `observer`. `make` and its targets are the real ones.
    """
    for name in (*COPIED, *SOURCES):
        source, target = ROOT / name, tmp_path / name
        if source.is_dir():
            shutil.copytree(source, target, ignore=shutil.ignore_patterns("__pycache__"))
        else:
            target.parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(source, target)
    programs = tmp_path / ".venv" / "bin"
    programs.mkdir(parents=True)
    for name, arguments in (("observer", "-m observer"), ("python", ""), ("python3", "")):
        program = programs / name
        program.write_text(f'#!/bin/sh\nexec "{sys.executable}" {arguments} "$@"\n')
        program.chmod(0o755)
    for name in STAMPS:
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).touch()
    return tmp_path


@pytest.fixture
def environment(workplace: Path) -> dict[str, str]:
    """The shell's environment after `. .venv/bin/activate`, without what a make that runs the tests adds."""
    of_make = ("MAKEFLAGS", "MFLAGS", "MAKELEVEL", "MAKEOVERRIDES")
    return {name: value for name, value in os.environ.items() if name not in of_make} | {
        "PATH": f"{workplace / '.venv' / 'bin'}:{os.environ['PATH']}",
        "PYTHONPATH": str(ROOT),
        "COLUMNS": "110",
        "NO_COLOR": "1",
        "TERM": "dumb",
    }


@pytest.mark.system
@pytest.mark.slow
@pytest.mark.timeout(1200)
@pytest.mark.parametrize("page", PAGES, ids=_name)
def test_commands_of_a_page_work(page: Path, workplace: Path, environment: dict[str, str]) -> None:
    for command in commands(page):
        place = f"{_name(page)}:{command.line}: {command.text}"
        done = subprocess.run(
            ["bash", "-euo", "pipefail", "-c", command.text],
            cwd=workplace,
            env=environment,
            stdin=subprocess.DEVNULL,
            capture_output=True,
            text=True,
            timeout=5 * PATIENCE_S,
        )
        assert done.returncode == 0, f"{place}\nexit code {done.returncode}\n{done.stdout}\n{done.stderr}"
        if command.expected:
            assert matches(command.expected, done.stdout + without_progress(done.stderr)), (
                f"{place}\nthe page shows:\n{command.expected}\nprinted:\n{done.stdout}{done.stderr}"
            )


@pytest.mark.parametrize("page", PAGES, ids=_name)
def test_no_command_runs_for_ever(page: Path) -> None:
    endless = [f"{c.page}:{c.line}: {c.text}" for c in commands(page) if not bounded(c)]
    assert not endless, f"bound these with --seconds or timeout: {endless}"
