"""The systemd unit: what it promises on other pages, and that systemd finds nothing wrong in it."""

from __future__ import annotations

import re
import shutil
import subprocess
from pathlib import Path

import pytest

UNIT = Path(__file__).parents[2] / "observer/installation/systemd" / "ballscrew-observer.service"
TEXT = UNIT.read_text(encoding="utf-8")


def _value(key: str) -> list[str]:
    return [word for line in re.findall(rf"^{key}=(.*)$", TEXT, re.MULTILINE) for word in line.split()]


def test_it_waits_for_the_right_time() -> None:
    assert "time-sync.target" in _value("After")
    assert "time-sync.target" in _value("Wants")


def test_a_reload_asks_the_service_itself() -> None:
    assert _value("ExecReload") == ["/bin/kill", "-HUP", "$MAINPID"]


def test_what_it_keeps_is_for_its_owner_only() -> None:
    assert _value("StateDirectoryMode") == ["0700"]
    assert _value("UMask") == ["0077"]


@pytest.mark.skipif(shutil.which("systemd-analyze") is None, reason="no systemd-analyze")
def test_systemd_finds_nothing_wrong() -> None:
    done = subprocess.run(
        ["systemd-analyze", "verify", str(UNIT)], capture_output=True, text=True, timeout=60
    )
    said = [line for line in done.stderr.splitlines() if UNIT.name in line]
    assert not [line for line in said if "is not executable" not in line]  # it is not installed here
