"""Reads the Dockerfile and carries out its steps below a directory, as whoever runs it.

The directory stands for the image's root: absolute paths in the steps are moved below it, and the image's
user becomes the one who runs the steps. What this cannot show is the base image itself and the isolation of
a container.
"""

from __future__ import annotations

import json
import os
import re
import shlex
import shutil
import subprocess
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

# The top-level directories of the image that the Dockerfile writes to.
MOVED = re.compile(r"(?<![\w.\-])/(?=(?:src|opt|var|config|tmp)\b)")


@dataclass(frozen=True, slots=True)
class Step:
    """One instruction: its word, and what follows it on one line."""

    word: str
    text: str

    def words(self) -> list[str]:
        """The arguments, given as JSON or in shell form."""
        return list(json.loads(self.text)) if self.text.startswith("[") else shlex.split(self.text)


def parse(path: Path) -> list[Step]:
    """The instructions in order; comments dropped, continued lines joined."""
    text = re.sub(r"^\s*#.*\n", "", path.read_text(), flags=re.M)
    lines = re.sub(r"\\\n\s*", "", text).splitlines()
    return [Step(*line.split(None, 1)) for line in lines if line.strip()]


@dataclass(slots=True)
class Machine:
    """A root directory, who works in it, and the environment variables gathered so far."""

    root: Path
    context: Path
    uid: int
    gid: int
    environment: dict[str, str]
    directory: str = "/"
    log: list[str] = field(default_factory=list)

    def moved(self, text: str) -> str:
        """`text` with the image's absolute paths below the root and its user replaced by ours."""
        return MOVED.sub(f"{self.root}/", text).replace("10001:10001", f"{self.uid}:{self.gid}")

    def run(self, words: list[str], timeout_s: float = 600.0) -> subprocess.CompletedProcess[str]:
        """A command as the image's user, in the image's environment only."""
        return subprocess.run(
            words, timeout=timeout_s, capture_output=True, text=True, check=False, **self.identity()
        )  # fmt: skip

    def identity(self) -> dict[str, object]:
        """The arguments of `subprocess` that make a process the image's own."""
        who = {"user": self.uid, "group": self.gid, "extra_groups": []} if os.geteuid() == 0 else {}
        here = self.root / self.directory.strip("/")
        return {"cwd": here, "env": self.environment, "stdin": subprocess.DEVNULL, **who}


def carry_out(steps: list[Step], machine: Machine) -> None:
    """Perform the instructions; raises `RuntimeError` with the output of a step that fails."""
    stages = 0
    for step in steps:
        match step.word:
            case "FROM":
                stages += 1
                if stages > 1:
                    _next_stage(steps, machine)
                machine.directory = "/"
            case "WORKDIR":
                machine.directory = step.text
                _make(machine, machine.root / step.text.strip("/"))
            case "COPY":
                _copy(step, machine)
            case "ENV" | "ARG":  # an argument has its default here
                machine.environment |= _variables(step, machine)
            case "RUN":
                _run(step, machine)


def _run(step: Step, machine: Machine) -> None:
    done = machine.run(["/bin/sh", "-c", machine.moved(step.text)])
    machine.log.append(f"exit {done.returncode}: RUN {step.text}")
    if done.returncode != 0:
        raise RuntimeError(f"RUN {step.text}\n{done.stdout}\n{done.stderr}")


def _variables(step: Step, machine: Machine) -> Mapping[str, str]:
    """The variables of an ENV or ARG step; programs of this machine stay on the path behind the image's."""
    given = dict(word.split("=", 1) for word in step.words())
    given = {key: machine.moved(value) for key, value in given.items()}
    if "PATH" in given:
        given["PATH"] += ":" + machine.environment["PATH"]
    return given


def _copy(step: Step, machine: Machine) -> None:
    words = step.words()
    if words[0].startswith("--from="):
        if words[1] != words[2]:
            raise RuntimeError(
                f"COPY {step.text}: between stages only to the same path, as virtual environments do"
            )
        return
    *sources, target = words
    into = (
        machine.root
        / (machine.directory if not target.startswith("/") else "").strip("/")
        / target.strip("/")
    )
    for source in sources:
        origin = machine.context / source
        if origin.is_dir():
            shutil.copytree(origin, into, ignore=shutil.ignore_patterns("__pycache__"), dirs_exist_ok=True)
        else:
            _make(machine, into)
            shutil.copy(origin, into)
        _own(machine, into)


def _next_stage(steps: list[Step], machine: Machine) -> None:
    """Keep of the stage before only what a later step copies from it."""
    kept = [machine.root / s.words()[1].strip("/") for s in steps if s.word == "COPY" and "--from=" in s.text]
    for path in sorted(machine.root.rglob("*"), key=lambda p: len(p.parts)):
        related = any(path == k or k in path.parents or path in k.parents for k in kept)
        if not related and path.exists():
            shutil.rmtree(path) if path.is_dir() and not path.is_symlink() else path.unlink()


def _make(machine: Machine, path: Path) -> None:
    path.mkdir(parents=True, exist_ok=True)
    _own(machine, path)


def _own(machine: Machine, path: Path) -> None:
    """Give a path to the image's user."""
    if os.geteuid() == 0:
        for each in [path, *path.rglob("*")]:
            os.chown(each, machine.uid, machine.gid, follow_symlinks=False)
