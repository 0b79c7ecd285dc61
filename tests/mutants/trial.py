"""A copy of the tree in which mutants are put to the tests, one after the other."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import time
from pathlib import Path

from tests.mutants.nearest import ROOT, Nearest

COPIED = ("observer", "drivers", "tests", "config", "benchmarks", "docs", "pyproject.toml", "README.md")
PYTEST = (
    "-q", "-x", "--tb=no", "-p", "no:randomly", "-p", "no:cacheprovider", "-p", "no:benchmark", "-p",
    "no:faulthandler", "--noconftest", "--hypothesis-seed=1", "-W",
    "ignore::pytest.PytestAssertRewriteWarning",
)  # fmt: skip
# Interpreted, a kernel divides and overflows as numpy's scalars do, which warn; compiled it does not.
INTERPRETED = ("-W", "ignore::RuntimeWarning")


class Tree:
    """A copy of the sources below `folder`, with its own cache of compiled kernels."""

    def __init__(self, folder: Path) -> None:
        self.root = folder / "tree"
        self._warm, self._cold = folder / "kernels", folder / "kernels-of-a-mutant"
        self._interpreting: subprocess.Popen[str] | None = None
        shutil.rmtree(self.root, ignore_errors=True)
        for name in COPIED:
            source, target = ROOT / name, self.root / name
            target.parent.mkdir(parents=True, exist_ok=True)
            if source.is_dir():
                shutil.copytree(source, target, ignore=shutil.ignore_patterns("__pycache__"))
            else:
                shutil.copy2(source, target)

    def passes(self, nearest: Nearest, limit_s: float, *, mutant: bool = False) -> tuple[bool, float]:
        """Whether the tests pass within a time, and how long they took."""
        start_s = time.monotonic()
        if nearest.compiled:
            # Kernels are looked up under NUMBA_CACHE_DIR as it was when numba was imported: a process each.
            with self._process({"NUMBA_CACHE_DIR": str(self._copied() if mutant else self._warm)}) as fresh:
                done = _ask(fresh, [*PYTEST, *nearest.tests], limit_s)
                fresh.kill()
        else:
            if self._interpreting is None:
                self._interpreting = self._process({"NUMBA_DISABLE_JIT": "1"})
            done = _ask(self._interpreting, [*PYTEST, *INTERPRETED, *nearest.tests], limit_s)
        return done, time.monotonic() - start_s

    def close(self) -> None:
        """End what runs."""
        if self._interpreting is not None:
            self._interpreting.kill()
            self._interpreting.wait()

    def _process(self, more: dict[str, str]) -> subprocess.Popen[str]:
        paths = {"PYTHONPATH": str(self.root), "PYTHONDONTWRITEBYTECODE": "1", "OPENBLAS_NUM_THREADS": "1"}
        return subprocess.Popen(
            [sys.executable, "-m", "tests.mutants.forks"], cwd=self.root, env=os.environ | paths | more,
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
        )  # fmt: skip

    def passes_with(self, module: str, source: str, nearest: Nearest, limit_s: float) -> tuple[bool, float]:
        """The same with a module's source exchanged; it is put back after."""
        path = self.root / module
        original, stamp = path.read_text(encoding="utf-8"), path.stat()
        try:
            path.write_text(source, encoding="utf-8")
            return self.passes(nearest, limit_s, mutant=True)
        finally:
            path.write_text(original, encoding="utf-8")
            os.utime(path, ns=(stamp.st_atime_ns, stamp.st_mtime_ns))  # the kernels compiled from it are good

    def _copied(self) -> Path:
        """The kernels compiled from the code as it is: those that a mutant is not in are used again."""
        shutil.rmtree(self._cold, ignore_errors=True)
        if self._warm.exists():
            shutil.copytree(self._warm, self._cold)
        return self._cold


def _ask(process: subprocess.Popen[str], arguments: list[str], limit_s: float) -> bool:
    """Whether pytest passes with these arguments."""
    assert process.stdin is not None
    assert process.stdout is not None
    process.stdin.write(json.dumps([arguments, limit_s]) + "\n")
    process.stdin.flush()
    answer = process.stdout.readline()
    if not answer:
        raise RuntimeError("the process that runs the tests has ended")
    return int(answer) == 0
