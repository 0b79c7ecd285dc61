"""An installation that cannot be written, run by a user without a home."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tests.patience import PATIENCE_S
from tests.system.bad_inputs import TABLE
from tests.system.plant import ROOT, write

pytestmark = pytest.mark.system

# Root without capabilities obeys the permissions of files, as any other owner does.
POWERLESS = ["setpriv", "--bounding-set=-all", "--inh-caps=-all", "--no-new-privs"]


@pytest.fixture
def installed(tmp_path):
    """A copy of the packages in which nothing can be written."""
    place = tmp_path / "site-packages"
    for package in ("observer", "drivers"):
        shutil.copytree(ROOT / package, place / package, ignore=shutil.ignore_patterns("__pycache__"))
    folders = [place, *(p for p in place.rglob("*") if p.is_dir())]
    for folder in folders:
        folder.chmod(0o555)
    yield place
    for folder in folders:
        folder.chmod(0o755)


def _run(installed: Path, place: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    environment = {k: v for k, v in os.environ.items() if k != "XDG_CACHE_HOME"}
    environment |= {"PYTHONPATH": str(installed), "HOME": str(installed / "home"), "TMPDIR": str(place)}
    return subprocess.run(
        [*(POWERLESS if os.getuid() == 0 else []), sys.executable, "-m", "observer", *arguments],
        cwd=installed,
        env=environment,
        capture_output=True,
        text=True,
        timeout=PATIENCE_S,
    )


@pytest.mark.skipif(
    os.getuid() == 0 and not shutil.which("setpriv"),
    reason="as root, read-only folders need setpriv to be so",
)
def test_a_read_only_installation_without_a_home_works(installed, tmp_path):
    place = tmp_path / "tmp"
    place.mkdir()
    before = sorted(installed.rglob("*"))
    done = _run(installed, place, "check", "--config", str(write(tmp_path, TABLE)))
    assert done.returncode == 0, done.stderr
    assert sorted(installed.rglob("*")) == before
