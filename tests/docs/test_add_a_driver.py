"""The page that shows how to add a driver: its file and its line, put into a copy of the drivers, work."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import drivers
from tests.docs.console import blocks

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "docs" / "how-to" / "add-a-driver.md"
NUMBER = "28-0316a2794f10"
MACHINE = """
ambient = { channel = "ambient_degC" }
surface = { convection_W_m2K = 10 }
source = [{ name = "bearing", shape = "point", position_m = 0.0 }]
sensor = [{ name = "s1", channel = "screw_degC", position_m = 0.1 }]

[screw]
length_m = 1
diameter_m = 0.03
conductivity_W_mK = 45
density_kg_m3 = 7800
specific_heat_J_kgK = 480
"""


@pytest.fixture
def house(tmp_path: Path) -> Path:
    """A copy of the drivers with the page's file and its line."""
    copied = tmp_path / "drivers"
    shutil.copytree(Path(drivers.__file__).parent, copied, ignore=shutil.ignore_patterns("__pycache__"))
    driver, line = (body for _, language, body in blocks(PAGE) if language == "python")
    (copied / "one_wire.py").write_text(driver, encoding="utf-8")
    imported, union = (part.rstrip() for part in line.split("\n\n"))
    before = union.replace("\n    | OneWireSettings", "")
    text = (copied / "__init__.py").read_text(encoding="utf-8")
    assert text.count(before) == 1, "the page shows another list of drivers than there is"
    neighbour = "from drivers.player import"
    text = text.replace(before, union).replace(neighbour, f"{imported}\n{neighbour}")
    (copied / "__init__.py").write_text(text, encoding="utf-8")
    return tmp_path


def _run(house: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    environment = os.environ | {"PYTHONPATH": f"{house}{os.pathsep}{ROOT}", "COLUMNS": "200"}
    command = [sys.executable, "-m", "observer", *arguments]
    return subprocess.run(command, env=environment, cwd=house, capture_output=True, text=True, check=False)


@pytest.mark.system
@pytest.mark.parametrize(("content", "shown"), [("23437\n", "23.4"), ("no number", "unreadable")])
def test_the_page_s_driver_reads_a_thermometer(house: Path, content: str, shown: str) -> None:
    file = house / "w1" / NUMBER / "temperature"
    file.parent.mkdir(parents=True)
    file.write_text(content, encoding="utf-8")
    channels = f'channels = {{ ambient_degC = "{NUMBER}", screw_degC = "{NUMBER}" }}'
    text = f'{MACHINE}\n[drivers.air]\nkind = "one_wire"\ndirectory = "w1"\n{channels}\n'
    config = house / "machine.toml"
    config.write_text(text, encoding="utf-8")
    done = _run(house, "check", "--wires", "--config", str(config))
    assert "ambient_degC" in done.stdout, done.stdout + done.stderr
    assert shown in done.stdout


@pytest.mark.system
def test_a_slip_in_its_table_is_told_like_any_other(house: Path) -> None:
    config = house / "machine.toml"
    config.write_text(MACHINE + '\n[drivers.air]\nkind = "onewire"\n', encoding="utf-8")
    done = _run(house, "check", "--config", str(config))
    assert done.returncode == 2
    assert "one_wire" in done.stderr
