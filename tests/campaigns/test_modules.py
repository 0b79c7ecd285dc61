"""Campaigns and benchmarks run too rarely to be found broken by use: they are at least imported here."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
IMPORT = "import importlib, sys\nfor name in sys.argv[1:]:\n    importlib.import_module(name)\n"


@pytest.mark.slow
def test_every_module_can_be_imported() -> None:
    """In a process of its own: some set up what all of a process shares, as BLAS's threads. What mypy sees
    of them at each change is not this, but most of it.
    """
    modules = [
        ".".join(path.relative_to(ROOT).with_suffix("").parts)
        for folder in ("campaigns", "benchmarks")
        for path in sorted((ROOT / folder).rglob("*.py"))
    ]
    assert len(modules) > 1
    command = [sys.executable, "-c", IMPORT, *modules]
    ended = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert (ended.returncode, ended.stdout, ended.stderr) == (0, "", "")
