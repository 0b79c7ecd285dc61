"""An installation that cannot be written, run by a user without a home: kernels are kept elsewhere."""

from __future__ import annotations

import os
import shutil
import stat
import subprocess
import sys
import tempfile
from pathlib import Path

import pytest

from observer import compile_cache
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
    environment = {k: v for k, v in os.environ.items() if k not in {compile_cache.VARIABLE, "XDG_CACHE_HOME"}}
    environment |= {"PYTHONPATH": str(installed), "HOME": str(installed / "home"), "TMPDIR": str(place)}
    return subprocess.run(
        [*(POWERLESS if os.getuid() == 0 else []), sys.executable, "-m", "observer", *arguments],
        cwd=installed,
        env=environment,
        capture_output=True,
        text=True,
        timeout=5 * PATIENCE_S,
    )


@pytest.mark.skipif(
    os.getuid() == 0 and not shutil.which("setpriv"),
    reason="as root, read-only folders need setpriv to be so",
)
def test_a_read_only_installation_without_a_home_works(installed, tmp_path):
    place = tmp_path / "tmp"
    place.mkdir()
    done = _run(installed, place, "check", "--config", str(write(tmp_path, TABLE)))
    assert done.returncode == 0, done.stderr
    cache = place / f"ballscrew-observer-{os.getuid()}"
    assert stat.S_IMODE(cache.stat().st_mode) == 0o700
    assert any(cache.rglob("*.nbi"))
    assert not list(installed.rglob("*.nbi"))


@pytest.fixture
def nowhere(monkeypatch, tmp_path):
    """None of numba's own places can be written; temporary files go to `tmp_path`."""
    monkeypatch.setattr(compile_cache, "_can_write", lambda place: False)
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    monkeypatch.setenv(compile_cache.VARIABLE, "")  # so that it is put back, also where there was none
    monkeypatch.delenv(compile_cache.VARIABLE)
    return tmp_path / f"ballscrew-observer-{os.getuid()}"


def test_what_others_may_write_is_not_trusted(nowhere):
    """Kernels are loaded as code, so a directory that somebody else has prepared must not be used."""
    nowhere.mkdir()
    nowhere.chmod(0o777)
    compile_cache.choose_compile_cache()
    chosen = Path(os.environ[compile_cache.VARIABLE])
    assert chosen != nowhere
    assert stat.S_IMODE(chosen.stat().st_mode) == 0o700


def test_a_link_is_not_followed(nowhere, tmp_path):
    (tmp_path / "elsewhere").mkdir(mode=0o700)
    nowhere.symlink_to(tmp_path / "elsewhere")
    compile_cache.choose_compile_cache()
    assert Path(os.environ[compile_cache.VARIABLE]) != nowhere


def test_a_place_that_can_be_written_is_left_to_numba(monkeypatch, tmp_path):
    monkeypatch.setenv(compile_cache.VARIABLE, str(tmp_path / "mine" / "below"))
    compile_cache.choose_compile_cache()
    assert os.environ[compile_cache.VARIABLE] == str(tmp_path / "mine" / "below")
