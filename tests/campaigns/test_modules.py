"""Campaigns and benchmarks run too rarely to be found broken by use: they are at least imported here."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[2]
IMPORT = """
import importlib, sys, traceback
for name in sys.argv[1:]:
    try:
        importlib.import_module(name)
    except Exception:
        print(name, traceback.format_exc())
"""


def test_every_module_can_be_imported() -> None:
    """In a process of its own: some set up what all of a process shares, as BLAS's threads."""
    modules = [
        ".".join(path.relative_to(ROOT).with_suffix("").parts)
        for folder in ("campaigns", "benchmarks")
        for path in sorted((ROOT / folder).rglob("*.py"))
    ]
    assert len(modules) > 1
    ended = subprocess.run(
        [sys.executable, "-c", IMPORT, *modules], cwd=ROOT, stdout=subprocess.PIPE, text=True, check=True
    )
    assert ended.stdout == ""
