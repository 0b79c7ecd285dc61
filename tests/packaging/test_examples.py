"""The examples in config/ can be used as they are."""

from __future__ import annotations

import itertools
import shutil
import subprocess
from pathlib import Path

import pytest

from observer import config

ROOT = Path(__file__).parents[2]
EXAMPLES = sorted((ROOT / "config").glob("*.toml"))


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda p: p.name)
def test_every_example_loads(path: Path) -> None:
    loaded = config.load(path)
    heats = sum(s.estimate for s in loaded.source)
    assert len(loaded.sensor) >= heats, "fewer sensors than heats: constant heats cannot all be observed"


def test_kim_uses_the_diffusivity_of_the_table() -> None:
    screw = config.load(ROOT / "config" / "kim-screw.toml").screw
    diffusivity_m2_s = screw.conductivity_W_mK / (screw.density_kg_m3 * screw.specific_heat_J_kgK)
    assert diffusivity_m2_s == pytest.approx(1.67e-5, rel=1e-4)  # the file gives c with five digits


def test_li_lies_inside_its_screw_and_matches_its_table() -> None:
    loaded = config.load(ROOT / "config" / "li-lathe-axis.toml")
    nut = loaded.source[0]
    assert nut.stroke_m is not None
    assert nut.stroke_m[1] - nut.stroke_m[0] == pytest.approx(0.42)
    positions_m = loaded.output.positions_m
    assert positions_m is not None
    steps_m = [b - a for a, b in itertools.pairwise(positions_m)]
    assert steps_m == pytest.approx([0.042] * 10)


def test_the_unit_is_valid_for_systemd(tmp_path: Path) -> None:
    if shutil.which("systemd-analyze") is None:
        pytest.skip("systemd-analyze is not installed on this machine")
    text = (ROOT / "config" / "ballscrew-observer.service").read_text()
    program = "/opt/ballscrew-observer/.venv/bin/observer"
    assert program in text
    unit = tmp_path / "ballscrew-observer.service"
    unit.write_text(text.replace(program, "/bin/true"))  # verify insists that the program exists
    done = subprocess.run(
        ["systemd-analyze", "verify", "--man=no", "--recursive-errors=no", str(unit)],
        capture_output=True, text=True, timeout=60,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert "ballscrew-observer.service" not in done.stderr, done.stderr
