"""The release workflow and the templates, as far as they can be checked without GitHub."""

from __future__ import annotations

import re
import shlex
import shutil
import subprocess
from pathlib import Path
from typing import Any

import pytest
import yaml
from typer.main import get_command

from observer.cli import app

ROOT = Path(__file__).parents[2]
WORKFLOWS = sorted((ROOT / ".github" / "workflows").glob("*.yml"))
TEMPLATES = [p for p in sorted((ROOT / ".github" / "ISSUE_TEMPLATE").glob("*.yml")) if p.name != "config.yml"]
TARGETS = set(re.findall(r"^([a-z][\w-]*):", (ROOT / "Makefile").read_text(), flags=re.M))
# What a runner has besides the repository.
OTHERS = {"python", "gh", "cd", "sha256sum", "apt-get"}
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
        else:
            assert words[0] in OTHERS, words


@pytest.mark.parametrize("workflow", WORKFLOWS, ids=lambda p: p.name)
def test_a_workflow_may_write_only_where_it_releases_and_holds_no_secret(workflow: Path) -> None:
    text = workflow.read_text()
    described = yaml.safe_load(text)
    assert described["permissions"] == {"contents": "read"}
    writing = [name for name, job in described["jobs"].items() if "permissions" in job]
    assert writing == (["release"] if workflow == RELEASE else [])
    assert "secrets." not in text
    for step in steps(workflow):
        assert re.fullmatch(r"actions/[\w-]+@v\d+", step.get("uses", "actions/none@v0"))


def test_each_python_from_the_oldest_supported_on_is_checked() -> None:
    oldest = re.search(r'^requires-python = ">=3\.(\d+)"', (ROOT / "pyproject.toml").read_text(), flags=re.M)
    assert oldest
    check = yaml.safe_load((RELEASE.parent / "check.yml").read_text())
    checked = check["jobs"]["unit"]["strategy"]["matrix"]["python"]
    assert checked == [f"3.{int(oldest[1]) + i}" for i in range(len(checked))]


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


@pytest.mark.parametrize("template", TEMPLATES, ids=lambda p: p.stem)
def test_a_template_is_one_that_github_takes(template: Path) -> None:
    form = yaml.safe_load(template.read_text())
    assert {"name", "description", "body"} <= form.keys() <= {"name", "description", "labels", "body"}
    ids = [part["id"] for part in form["body"]]
    assert len(set(ids)) == len(ids)
    for part in form["body"]:
        assert part["type"] in {"textarea", "input", "dropdown", "checkboxes", "markdown"}
        assert part["attributes"]["label"]
        assert part.get("validations", {}).keys() <= {"required"}


@pytest.mark.parametrize("template", TEMPLATES, ids=lambda p: p.stem)
def test_a_template_asks_for_commands_that_there_are(template: Path) -> None:
    known = set(get_command(app).commands)  # type: ignore[attr-defined]
    asked = re.findall(r"`observer ([\w-]+)", template.read_text())
    assert set(asked) <= known
    assert "check" in asked, "the first thing to look at"


@pytest.mark.parametrize("page", ["CONTRIBUTING.md", "docs/mutants.md", ".github/pull_request_template.md"])
def test_the_targets_named_on_a_page_exist(page: str) -> None:
    named = set(re.findall(r"(?:^|`)make ([a-z][\w-]*)", (ROOT / page).read_text(), flags=re.M))
    assert named
    assert named <= TARGETS


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
