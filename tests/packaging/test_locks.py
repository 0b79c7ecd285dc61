"""The lock files pin everything that pyproject.toml asks for, with hashes, and name no package index."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())
RUNTIME = PROJECT["project"]["dependencies"]
GROUPS = PROJECT["dependency-groups"]
EXTRAS = PROJECT["project"]["optional-dependencies"]
WANTED = {
    "requirements.lock": RUNTIME,
    "requirements-daemon.lock": RUNTIME + EXTRAS["page"] + EXTRAS["plant"],
    "requirements-dev.lock": RUNTIME + GROUPS["dev"],
    "requirements-build.lock": GROUPS["build"],
}


def _name(requirement: str) -> str:
    """The normalised name of a requirement."""
    found = re.match(r"[A-Za-z0-9._-]+", requirement)
    assert found
    return re.sub(r"[-_.]+", "-", found[0]).lower()


@pytest.mark.parametrize("lock", sorted(WANTED))
def test_a_lock_pins_all_that_is_asked_for(lock: str) -> None:
    pinned = {_name(line) for line in (ROOT / lock).read_text().splitlines() if "==" in line}
    assert {_name(r) for r in WANTED[lock]} <= pinned, f"run `make lock`: {lock} is behind pyproject.toml"


@pytest.mark.parametrize("lock", sorted(WANTED))
def test_every_pin_has_a_hash(lock: str) -> None:
    entries = re.split(r"^(?=\S)", (ROOT / lock).read_text(), flags=re.M)
    bare = [entry.splitlines()[0] for entry in entries if entry.strip() and "--hash=sha256:" not in entry]
    assert not bare


@pytest.mark.parametrize("lock", sorted(WANTED))
def test_a_lock_names_no_index(lock: str) -> None:
    assert not re.search(r"https?://|--(extra-)?index-url|--find-links", (ROOT / lock).read_text())


def test_the_environments_agree_on_versions() -> None:
    def pins(lock: str) -> set[str]:
        text = (ROOT / lock).read_text()
        return {re.split(r"[\\;]", line)[0].strip() for line in text.splitlines() if "==" in line}

    assert pins("requirements-daemon.lock") < pins("requirements.lock") < pins("requirements-dev.lock")


def test_the_image_has_what_a_daemon_needs_and_nothing_of_an_analyst() -> None:
    pinned = {
        _name(line) for line in (ROOT / "requirements-daemon.lock").read_text().splitlines() if "==" in line
    }
    assert not pinned & {"control", "filterpy", "matplotlib", "distributed", "dask"}
    assert "ARG LOCK=requirements-daemon.lock" in (ROOT / "Dockerfile").read_text()
