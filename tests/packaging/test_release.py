"""The workflows, as far as they can be checked without GitHub."""

from __future__ import annotations

import re
import shlex
import shutil
import subprocess
from pathlib import Path
from typing import Any

import pytest
import yaml

ROOT = Path(__file__).parents[2]
WORKFLOWS = sorted((ROOT / ".github" / "workflows").glob("*.yml"))
TARGETS = set(re.findall(r"^([a-z][\w-]*):", (ROOT / "Makefile").read_text(), flags=re.M))
RELEASE = ROOT / ".github" / "workflows" / "release.yml"


def steps(workflow: Path) -> list[dict[str, Any]]:
    jobs = yaml.safe_load(workflow.read_text())["jobs"]
    return [step for job in jobs.values() for step in job["steps"]]


def commands(run: str) -> list[list[str]]:
    """The commands of a step, each as its words."""
    return [shlex.split(part) for line in run.splitlines() for part in line.split(" && ")]


@pytest.mark.parametrize("workflow", WORKFLOWS, ids=lambda p: p.name)
def test_what_a_workflow_runs_is_there(workflow: Path) -> None:
    found = [words for step in steps(workflow) for words in commands(step.get("run", ""))]
    assert found
    for words in found:
        if words[0] == "make":
            assert {word for word in words[1:] if "=" not in word} <= TARGETS, words
        elif "/" in words[0]:
            script = ROOT / words[0]
            assert script.is_file(), words
            assert script.stat().st_mode & 0o111, f"{words[0]} cannot be run"


def test_only_a_checked_tag_of_the_version_is_released() -> None:
    described = yaml.safe_load(RELEASE.read_text())
    assert described[True] == {"push": {"tags": ["v*"]}}  # YAML reads `on` as true
    assert described["jobs"]["release"]["needs"] == "check", "nothing is released that was not checked"
    (guard,) = [step["run"] for step in steps(RELEASE) if step.get("name") == "The tag is the version"]

    def passes(tag: str) -> bool:
        environment = {"GITHUB_REF_NAME": tag, "PATH": "/usr/bin:/bin"}
        own = guard.replace("python -c", f"{shlex.quote(_python())} -c", 1)
        done = subprocess.run(["bash", "-c", own], env=environment, cwd=ROOT, capture_output=True)
        return done.returncode == 0

    version = re.search(r'^version = "(.*)"', (ROOT / "pyproject.toml").read_text(), flags=re.M)
    assert version
    assert passes(f"v{version[1]}")
    assert not passes("v999.0.0")


def _python() -> str:
    import sys

    return sys.executable


@pytest.mark.parametrize(("user", "through"), [("0", []), ("1001", ["sudo"])])
def test_ci_installs_its_packages_through_sudo_unless_it_is_root(
    user: str, through: list[str], tmp_path: Path
) -> None:
    """On a computer that has none of them; `make` has nothing to do here."""
    for name in ("bash", "dirname", "uname", "sed", "env"):
        (tmp_path / name).symlink_to(str(shutil.which(name)))
    said = tmp_path / "said"
    for name, text in {
        "id": f"echo {user}",
        "make": "true",
        "python3": "true",
        "apt-get": f'echo "apt-get $1" >> {said}',
        "sudo": f'echo sudo >> {said}; exec "$@"',
    }.items():
        (tmp_path / name).write_text(f"#!{tmp_path / 'bash'}\n{text}\n")
        (tmp_path / name).chmod(0o755)
    subprocess.run([ROOT / ".ci" / "run"], env={"PATH": str(tmp_path)}, check=True, capture_output=True)
    assert said.read_text().splitlines() == [*through, "apt-get update", *through, "apt-get install"]
