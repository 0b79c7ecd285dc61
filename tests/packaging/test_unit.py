"""The systemd unit: what it promises on other pages, and that systemd finds nothing wrong in it."""

from __future__ import annotations

import re
import shutil
import subprocess
from pathlib import Path

import pytest

from tests.docs.console import blocks

ROOT = Path(__file__).parents[2]
UNIT = ROOT / "observer/installation/systemd" / "ballscrew-observer.service"
PAGE = ROOT / "docs" / "how-to" / "systemd.md"
TEXT = UNIT.read_text(encoding="utf-8")


def _verify(unit: Path) -> list[str]:
    """What systemd finds wrong in a unit, except that the program is not installed here."""
    command = ["systemd-analyze", "verify", "--man=no", "--recursive-errors=no", str(unit)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60)
    complaints = [line for line in done.stderr.splitlines() if unit.name.partition("@")[0] in line]
    return [line for line in complaints if "is not executable" not in line]


@pytest.mark.skipif(shutil.which("systemd-analyze") is None, reason="no systemd-analyze")
def test_systemd_finds_nothing_wrong() -> None:
    assert not _verify(UNIT)


def test_the_page_installs_every_shipped_file_and_removes_it() -> None:
    install, template, remove = (body for _, language, body in blocks(PAGE) if language == "text")
    assert set(re.findall(r"\$files/(\S+)", install)) == {path.name for path in UNIT.parent.iterdir()}
    placed = set(re.findall(r"/etc/(?:sysusers|tmpfiles)\.d/\S+", install)) | {
        f"/etc/systemd/system/{UNIT.name}"
    }
    assert set(re.findall(r"/etc/\S+", remove)) == placed
    assert UNIT.name in template


@pytest.mark.skipif(shutil.which("systemd-analyze") is None, reason="no systemd-analyze")
def test_the_page_makes_a_template_for_several_axes(tmp_path: Path) -> None:
    (line,) = [line for line in PAGE.read_text().splitlines() if line.startswith("sed ")]
    shutil.copy(UNIT, tmp_path)
    subprocess.run(line.replace("sudo ", ""), shell=True, cwd=tmp_path, check=True, stdout=subprocess.DEVNULL)
    template = tmp_path / "ballscrew-observer@.service"
    assert "--config /etc/ballscrew-observer/%i.toml" in template.read_text()
    assert "TimeoutStartSec=180" in template.read_text()
    assert not _verify(template)
