"""A copy of the tree in which mutants are put to the tests, one after the other."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

from tests.mutants.nearest import ROOT, Nearest

COPIED = ("observer", "drivers", "tests", "config", "benchmarks", "docs", "pyproject.toml", "README.md")
PYTEST = (
    "-m", "pytest", "-q", "-x", "--tb=no", "-p", "no:randomly", "-p", "no:cacheprovider", "-p",
    "no:benchmark", "--hypothesis-seed=1",
)  # fmt: skip


class Tree:
    """A copy of the sources below `folder`, with its own cache of compiled kernels."""

    def __init__(self, folder: Path) -> None:
        self.root = folder / "tree"
        self._warm, self._cold = folder / "kernels", folder / "kernels-of-a-mutant"
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
        compiling = {"NUMBA_DISABLE_JIT": "1"}
        if nearest.compiled:
            compiling = {"NUMBA_CACHE_DIR": str(self._copied() if mutant else self._warm)}
        # Interpreted, a kernel divides and overflows as numpy's scalars do, which warn; compiled it does not.
        quiet = () if nearest.compiled else ("-W", "ignore::RuntimeWarning")
        paths = {"PYTHONPATH": str(self.root), "PYTHONDONTWRITEBYTECODE": "1", "OPENBLAS_NUM_THREADS": "1"}
        start_s = time.monotonic()
        process = subprocess.Popen(
            [sys.executable, *PYTEST, *quiet, *nearest.tests],
            cwd=self.root, env=os.environ | paths | compiling, start_new_session=True,
            stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
        )  # fmt: skip
        try:
            done = process.wait(limit_s) == 0
        except subprocess.TimeoutExpired:
            done = False
        finally:
            if process.poll() is None:
                os.killpg(process.pid, signal.SIGKILL)
                process.wait()
        return done, time.monotonic() - start_s

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
