"""Every target of make that a page shows in a block of text is run, in a clone of its own."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tests.docs.console import blocks

ROOT = Path(__file__).parents[2]
PAGES = (ROOT / "CONTRIBUTING.md", ROOT / "docs" / "mutants.md", ROOT / "docs" / "how-to" / "install.md")
SLICES = (
    "unit ARGS=tests/physics",
    "near FILE=observer/model/couple.py",
    "system ARGS=tests/cli",
    "coverage ARGS=tests/physics",
    "format",
    "docs",
    "processors ARGS=tests/physics",  # all numeric tests on four processors take half an hour
    'bench ARGS="--only hour"',  # one of seven parts, which together take ten minutes
    "mutants ARGS=--page",
    # one mutant of one module, after two minutes in which kernels are compiled with checked bounds
    'mutants ARGS="--count 1 --only discovery/verdict --workers 1"',
)
"""What is run of each target: the whole, or a short slice of what takes long."""
ELSEWHERE = {
    "env": "fetches 1 GB: it is what every other target of CI begins with",
    "runtime": "fetches 0.3 GB: tests/packaging/test_dockerfile_steps.py installs the same lock",
    "lock": "asks the package index: tests/packaging/test_locks.py compares the locks with pyproject.toml",
    "operations-check": "needs root and fetches 150 MB: it is tests/packaging/test_operations.py itself",
}
"""Targets that need a network, and what covers them."""


def _shown() -> set[str]:
    """The targets in blocks of text."""
    lines = [
        line
        for page in PAGES
        for _, kind, body in blocks(page)
        if kind == "text"
        for line in body.splitlines()
    ]
    calls = [match[1] for line in lines if (match := re.match(r"(?:sudo )?make ((?:[a-z-]+(?: |$))+)", line))]
    return {target for call in calls for target in call.split()}


def _of_ci() -> set[str]:
    """The targets that a workflow runs."""
    text = "".join(path.read_text("utf-8") for path in (ROOT / ".github" / "workflows").glob("*.yml"))
    return set(re.findall(r"run: make ([a-z-]+)", text))


def test_every_target_on_a_page_is_run() -> None:
    run = {command.split()[0] for command in SLICES} | set(ELSEWHERE) | _of_ci()
    assert "unit" in _shown()
    assert _shown() - run <= {"test", "slow"}, "`test` is lint, unit and system; `slow` runs this test itself"


@pytest.fixture(scope="module")
def clone(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A clone with this tree's files, after `make env`."""
    place = tmp_path_factory.mktemp("clone")
    listed = subprocess.run(["git", "ls-files"], cwd=ROOT, capture_output=True, text=True, check=True)
    for name in listed.stdout.splitlines():
        (place / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(ROOT / name, place / name)
    for built in (ROOT / "observer" / "kernels").rglob("core*.so"):
        target = place / built.relative_to(ROOT)
        target.parent.mkdir(exist_ok=True)
        shutil.copy(built, target)
    git = ["git", "-c", "user.name=test", "-c", "user.email=test@localhost"]
    for command in (["init", "-q"], ["add", "."], ["commit", "-q", "-m", "The tree"]):
        subprocess.run([*git, *command], cwd=place, check=True)
    (place / ".venv").mkdir()
    for part in Path(sys.prefix).iterdir():
        if part.name in ("bin", "lib", "share", "pyvenv.cfg"):
            (place / ".venv" / part.name).symlink_to(part)
    for stamp in ("build/uv/bin/uv", ".venv/requirements-dev.lock.synced", ".venv/.ready"):
        (place / stamp).parent.mkdir(parents=True, exist_ok=True)
        (place / stamp).touch()
    return place


@pytest.mark.system
@pytest.mark.slow
@pytest.mark.timeout(1200)
@pytest.mark.parametrize("command", SLICES)
def test_a_target_works(command: str, clone: Path) -> None:
    done = subprocess.run(
        f"make {command}", shell=True, cwd=clone, env=os.environ | {"PYTHONPATH": str(clone)},
        stdin=subprocess.DEVNULL, capture_output=True, text=True, timeout=1000,
    )  # fmt: skip
    assert done.returncode == 0, f"{done.stdout[-3000:]}\n{done.stderr[-3000:]}"
