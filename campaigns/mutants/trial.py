"""A copy of the tree in which mutants are put to the tests, one after the other."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import time
from pathlib import Path

from campaigns.mutants.nearest import ROOT, Nearest
from observer.kernels.files import digest

COPIED = (
    "observer", "drivers", "tests", "campaigns", "benchmarks", "config", "docs", "pyproject.toml",
    "README.md", "setup.py", "build_kernels.py",
)  # fmt: skip
PYTEST = (
    "-q", "-x", "--tb=no", "-p", "no:randomly", "-p", "no:cacheprovider", "-p", "no:benchmark", "-p",
    "no:faulthandler", "--noconftest", "--hypothesis-seed=1", "--hypothesis-profile=ci", "-W",
    "ignore::pytest.PytestAssertRewriteWarning",
)  # fmt: skip
PATHS = {"PYTHONDONTWRITEBYTECODE": "1", "OPENBLAS_NUM_THREADS": "1", "OBSERVER_KERNELS": "any"}


class Tree:
    """A copy of the sources below `folder`, and the processes that run tests in it."""

    def __init__(self, folder: Path) -> None:
        self.root = folder / "tree"
        self._built = ""
        self._running: subprocess.Popen[str] | None = None
        shutil.rmtree(self.root, ignore_errors=True)
        for name in COPIED:
            source, target = ROOT / name, self.root / name
            target.parent.mkdir(parents=True, exist_ok=True)
            if source.is_dir():
                shutil.copytree(source, target, ignore=shutil.ignore_patterns("__pycache__"))
            else:
                shutil.copy2(source, target)

    def passes(self, nearest: Nearest, limit_s: float) -> tuple[bool, float]:
        """Whether the tests pass within a time, and how long they took."""
        builds = self._builds()
        start_s = time.monotonic()
        if self._running is None:
            self._running = self._process()
        done = builds and _ask(self._running, [*PYTEST, *nearest.tests], limit_s)
        return done, time.monotonic() - start_s

    def close(self) -> None:
        """End what runs."""
        if self._running is not None:
            self._running.kill()
            self._running.wait()

    def _builds(self) -> bool:
        """Compile the kernels with checked bounds where they have changed; return whether that works."""
        files = digest(self.root / "observer/kernels")
        if files != self._built:
            self._built = files
            return build_checked(self.root).returncode == 0
        return True

    def _process(self) -> subprocess.Popen[str]:
        return subprocess.Popen(
            [sys.executable, "-m", "campaigns.mutants.forks"], cwd=self.root,
            env=os.environ | PATHS | {"PYTHONPATH": str(self.root)},
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
        )  # fmt: skip

    def passes_with(self, module: str, source: str, nearest: Nearest, limit_s: float) -> tuple[bool, float]:
        """The same with a module's source exchanged; it is put back after."""
        path = self.root / module
        original = path.read_text(encoding="utf-8")
        try:
            path.write_text(source, encoding="utf-8")
            return self.passes(nearest, limit_s)
        finally:
            path.write_text(original, encoding="utf-8")


def build_checked(root: Path) -> subprocess.CompletedProcess[str]:
    """Compile the kernels of a tree, so that an index out of bounds is an error."""
    return subprocess.run(
        [sys.executable, "setup.py", "-q", "build_ext", "--inplace"], cwd=root,
        env=os.environ | {"KERNELS_CHECKED": "1"}, capture_output=True, text=True, check=False,
    )  # fmt: skip


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
