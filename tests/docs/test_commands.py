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


def _name(page: Path) -> str:
    return str(page.relative_to(ROOT))


@pytest.fixture
def workplace(tmp_path: Path) -> Path:
    """A directory like a fresh checkout's top, without the environment."""
    for name in COPIED:
        source, target = ROOT / name, tmp_path / name
        if source.is_dir():
            shutil.copytree(source, target, ignore=shutil.ignore_patterns("__pycache__"))
        elif source.exists():
            target.parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(source, target)
    return tmp_path


@pytest.fixture
def environment(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """The shell's environment: this interpreter as `python`, this tree's `observer`."""
    programs = tmp_path_factory.mktemp("bin")
    for name, arguments in (("observer", "-m observer"), ("python", ""), ("python3", "")):
        program = programs / name
        program.write_text(f'#!/bin/sh\nexec "{sys.executable}" {arguments} "$@"\n')
        program.chmod(0o755)
    return os.environ | {
        "PATH": f"{programs}:{os.environ['PATH']}",
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
        if command.text.startswith("make "):
            _make_target_exists(command.text, place)
            continue
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


def _make_target_exists(text: str, place: str) -> None:
    """`make` inside the tests that `make test` runs would never end: its targets are only planned (`-n`)."""
    done = subprocess.run(
        ["bash", "-c", text.replace("make ", "make -n ", 1)],
        cwd=ROOT,
        capture_output=True,
        text=True,
        timeout=PATIENCE_S,
    )
    assert done.returncode == 0, f"{place}\n{done.stderr}"


@pytest.mark.parametrize("page", PAGES, ids=_name)
def test_no_command_runs_for_ever(page: Path) -> None:
    endless = [
        f"{c.page}:{c.line}: {c.text}" for c in commands(page) if not bounded(c) and "make " not in c.text
    ]
    assert not endless, f"bound these with --seconds or timeout: {endless}"
