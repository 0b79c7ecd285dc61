"""The page that shows how to add an effect, followed: its class and its line, in a package of their own."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from observer.effects.catalogue import KINDS
from tests.docs.console import blocks

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "docs" / "how-to" / "add-an-effect.md"
FOLLOWED = '''
"""A search over three logs of a bar whose bearing rubs more in one sense of rotation."""
import numpy as np

from observer.discovery.candidates import library
from observer.discovery.discover import discover
from observer.fit.parameters import free_keys
from observer.model.build import build_plant
from observer.model.drive import Drive
from observer.model.simulate import simulate, start
from tests.discovery.cases import frames, machine

truth = machine(effect=[{"kind": "hanging_load", "target": "bearing.l", "fraction": 0.4}])
config = machine()
print([c.name for c in library(config, free_keys(config)) if c.kind == "hanging_load"])

def log(seed):
    time_s = np.arange(0.0, 7200.0, 2.0)
    until_s = [600, 2400, 3600, 5400]
    speed_rpm = np.select([time_s < s for s in until_s], [0.0, 1000.0, 0.0, -1500.0], 0.0)
    columns = {"n_rpm": speed_rpm, "heater_W": np.where((time_s > 300) & (time_s < 1800), 15.0, 0.0)}
    blank = {s.channel: np.full_like(time_s, 20.0) for s in truth.sensor}
    plant = build_plant(truth)
    drive = Drive(truth, plant)
    inputs = drive.run(drive.initial(), frames(truth, time_s, columns | blank))[1]
    rows = simulate(plant, start(plant, 20.0, inputs.law_W[0]), inputs)[1]
    noise_K = 0.05 * np.random.default_rng(seed).normal(size=(len(time_s), len(truth.sensor)))
    columns |= {s.channel: rows[:, i] + noise_K[:, i] for i, s in enumerate(truth.sensor)}
    return frames(truth, time_s, columns)

found = discover(config, [[log(seed)] for seed in range(3)])
[effect] = found.verdict.fit.config.effect
print(found.verdict.kind, effect.kind, effect.target, round(effect.fraction, 2))
'''


def extended(folder: Path) -> Path:
    """A package in which the page was followed: all the same files but for those of the effects."""
    whole, line = (body for _, language, body in blocks(PAGE) if language == "python")
    for package in ("observer", "drivers", "tests"):
        (folder / package).mkdir(parents=True)
        for entry in (ROOT / package).iterdir():
            if entry != ROOT / "observer" / "effects":
                (folder / package / entry.name).symlink_to(entry)
    effects = folder / "observer" / "effects"
    shutil.copytree(ROOT / "observer" / "effects", effects, ignore=shutil.ignore_patterns("__pycache__"))
    heat, catalogue = effects / "heat.py", effects / "catalogue.py"
    heat.write_text(f"{heat.read_text(encoding='utf-8')}\n\n{whole}\n", encoding="utf-8")
    text, at = catalogue.read_text(encoding="utf-8"), "    | heat.Dwell\n"
    assert at in text
    catalogue.write_text(text.replace(at, f"{at}{line}\n"), encoding="utf-8")
    return folder


@pytest.mark.slow
def test_an_effect_added_as_the_page_says_is_found_by_a_search(tmp_path: Path) -> None:
    assert "hanging_load" not in KINDS
    folder = extended(tmp_path / "extended")
    done = subprocess.run(
        [sys.executable, "-c", FOLLOWED],
        cwd=folder,
        env=os.environ | {"PYTHONPATH": str(folder)},
        capture_output=True,
        text=True,
        timeout=500,
    )
    assert done.returncode == 0, done.stderr
    tried, found = done.stdout.splitlines()
    assert tried == "['hanging_load at bearing.l']"
    assert found == "named hanging_load bearing.l 0.4"
