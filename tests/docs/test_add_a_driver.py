"""The driver of the page that shows how to add one: named by the configuration, it works."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from observer.errors import ConfigError
from observer.installation import load
from tests.logs.machines import machine_text

ROOT = Path(__file__).parents[2]
EXAMPLE = ROOT / "docs" / "examples" / "one_wire.py"
KIND = "one_wire:OneWireSettings"
NUMBER = "28-0316a2794f10"
MACHINE = machine_text(
    "bearing",
    ambient={"channel": "ambient_degC"},
    source__0__speed_channel=None,
    source__0__heat_W_rpm=None,
    sensor=[{"name": "s1", "channel": "screw_degC", "position_m": 0.1}],
)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A folder on the path of modules, with the example."""
    shutil.copy(EXAMPLE, tmp_path)
    return tmp_path


def _run(folder: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    environment = os.environ | {"PYTHONPATH": f"{folder}{os.pathsep}{ROOT}", "COLUMNS": "200"}
    command = [sys.executable, "-m", "observer", *arguments]
    return subprocess.run(command, env=environment, cwd=folder, capture_output=True, text=True, check=False)


@pytest.mark.system
@pytest.mark.parametrize(("content", "shown"), [("23437\n", "23.4"), ("no number", "unreadable")])
def test_the_page_s_driver_reads_a_thermometer(folder: Path, content: str, shown: str) -> None:
    file = folder / "w1" / NUMBER / "temperature"
    file.parent.mkdir(parents=True)
    file.write_text(content, encoding="utf-8")
    channels = f'channels = {{ ambient_degC = "{NUMBER}", screw_degC = "{NUMBER}" }}'
    text = f'{MACHINE}\n[drivers.air]\nkind = "{KIND}"\ndirectory = "w1"\n{channels}\n'
    config = folder / "machine.toml"
    config.write_text(text, encoding="utf-8")
    done = _run(folder, "check", "--wires", "--config", str(config))
    assert "ambient_degC" in done.stdout, done.stdout + done.stderr
    assert shown in done.stdout


@pytest.mark.parametrize(
    ("kind", "said"),
    [
        ("onewire", "unknown kind 'onewire'; give one of modbus_tcp, .*, module:Class"),
        ("one_wire:OneWire", "not a driver's table; name a subclass of drivers.protocol.DriverTable"),
        ("one_wire:OneWired", "one_wire has no class OneWired; fix the name after the colon"),
        ("nowhere:OneWire", "No module named 'nowhere'.*; install its package beside this program"),
        (KIND, "drivers.air.channels: is missing; add it"),
    ],
)
def test_an_error_in_its_table_is_one_sentence(
    folder: Path, kind: str, said: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.syspath_prepend(folder)
    config = folder / "machine.toml"
    config.write_text(f'{MACHINE}\n[drivers.air]\nkind = "{kind}"\n', encoding="utf-8")
    with pytest.raises(ConfigError, match=said) as caught:
        load(config)
    sys.modules.pop("one_wire", None)
    assert len(str(caught.value).splitlines()) == 1
