"""A copy of the tree in which mutants are put to the tests, one after the other."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import grimp

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

    def passes(self, nearest: Nearest, limit_s: float, mutated: str | None = None) -> tuple[bool, float]:
        """Whether the tests pass within a time, and how long they took; `mutated` the module changed."""
        place = self._warm if mutated is None else self._colder(mutated)
        compiling = {"NUMBA_CACHE_DIR": str(place)} if nearest.compiled else {"NUMBA_DISABLE_JIT": "1"}
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
            return self.passes(nearest, limit_s, module)
        finally:
            path.write_text(original, encoding="utf-8")
            os.utime(path, ns=(stamp.st_atime_ns, stamp.st_mtime_ns))  # the kernels compiled from it are good

    def _colder(self, module: str) -> Path:
        """The compiled kernels without those that a module is in: of it, and of what imports it."""
        shutil.rmtree(self._cold, ignore_errors=True)
        if self._warm.exists():
            stale = {tuple(name.split(".")[-2:]) for name in _downstream(module)}
            shutil.copytree(self._warm, self._cold)
            for file in self._cold.rglob("*.nb?"):
                if (file.parent.name.rsplit("_", 1)[0], file.name.split(".")[0]) in stale:
                    file.unlink()
        return self._cold


def _downstream(module: str) -> set[str]:
    """A module and all that imports it, directly or through another, by their dotted names."""
    name = module.removesuffix(".py").replace("/", ".")
    graph = grimp.build_graph("observer", "drivers", cache_dir=None)
    return {name} | graph.find_downstream_modules(name)
