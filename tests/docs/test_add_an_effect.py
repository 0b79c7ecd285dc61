"""The page that shows how to add an effect, followed: from outside, and in a copy of the library."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

from observer import installation
from observer.config.effects.catalogue import KINDS
from observer.discovery.candidates import library
from observer.errors import ConfigError
from observer.fit.parameters import free_keys
from observer.installation import with_effects
from observer.report.wording import lack_of
from tests.docs.console import blocks

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "docs" / "how-to" / "add-an-effect.md"
RIG = ROOT / "tests" / "data" / "rig"
COVER = {"kind": "telescopic:Cover", "target": "nut", "heated": 0.4}
OUTSIDE = (ROOT / "docs" / "examples" / "telescopic.py").read_text(encoding="utf-8")
(IN_LIBRARY,) = (body for _, language, body in blocks(PAGE) if language == "python")
FOLLOWED = '''
"""A search over three logs of a bar for an effect of one of its bearings."""
import sys

import numpy as np

from observer.discovery.candidates import library
from observer.discovery.discover import discover
from observer.fit.parameters import free_keys
from observer.model.build import build_plant
from observer.model.drive import Drive
from observer.model.simulate import simulate, start
from tests.logs.machines import machine
from tests.logs.simulated import frames

kind, key, strength = sys.argv[1:]
also = {} if ":" not in kind else {"discover": {"also": [kind]}}
truth = machine(effect=[{"kind": kind, "target": "bearing.l", key: float(strength)}])
config = machine(**also)
found = library(config, free_keys(config), (), config.discover.also)
print([c.name for c in found if c.kind == kind])

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
print(found.verdict.kind, effect.kind, effect.target, round(getattr(effect, key), 2))
'''


@pytest.fixture
def cover(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Path:
    """A folder on the path with the page's module in it."""
    (tmp_path / "telescopic.py").write_text(OUTSIDE, encoding="utf-8")
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, "telescopic", raising=False)
    return tmp_path


def rig(*effects: dict[str, object], **more: object) -> installation.Installation:
    """The rig's configuration with effects."""
    table = tomllib.loads((RIG / "config.toml").read_text(encoding="utf-8"))
    return installation.parse(table | {"effect": list(effects)} | more)


def test_an_effect_from_outside_is_checked_like_ours(cover: Path) -> None:
    effect = rig(COVER).effect[0]
    assert (effect.kind, effect.model_dump()["loss_W_K"]) == ("telescopic:Cover", 20.0)
    assert effect.named() == "telescopic:Cover"
    assert 'kind = "telescopic:Cover"' in with_effects("", [effect])
    assert rig(COVER).digest != rig(COVER | {"heated": 0.5}).digest
    assert lack_of("telescopic:Cover", "nut") == "air under a cover that nut warms"


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"heated": 11.0}, "effect[0].heated: input should be less than or equal to 10"),
        ({"heatet": 1.0}, "effect[0].heatet: unknown key (did you mean heated?)"),
        ({"target": "nuts"}, 'target "nuts" is no source'),
        ({"kind": "telescopic:Hood"}, "telescopic has no class Hood"),
        ({"kind": "telescopic:Fitted"}, "name a subclass of observer.config.effects.base.EffectTable"),
        ({"kind": "nowhere:Cover"}, "put its folder on PYTHONPATH"),
        ({"kind": "covers"}, "unknown kind 'covers'; give one of surface_convection"),
    ],
)
def test_what_is_wrong_with_it_is_said(cover: Path, change: dict[str, object], said: str) -> None:
    with pytest.raises(ConfigError) as error:
        rig(COVER | change)
    assert said in str(error.value)


def test_a_search_tries_it_where_it_is_asked_to(cover: Path) -> None:
    config = rig(discover={"also": ["telescopic:Cover"]})
    names = [c.name for c in library(config, free_keys(config), (), config.discover.also)]
    assert "telescopic:Cover at nut" in names
    with pytest.raises(ConfigError, match="also: telescopic has no class Hood"):
        rig(discover={"also": ["telescopic:Hood"]})
    with pytest.raises(ConfigError, match='without: "covers" is no effect; give one of surface_convection'):
        rig(discover={"without": ["covers"]})


def extended(folder: Path) -> Path:
    """A package in which the page was followed: all the same files but for those of the effects."""
    for package in ("observer", "drivers", "tests"):
        (folder / package).mkdir(parents=True)
        for entry in (ROOT / package).iterdir():
            if entry != ROOT / "observer" / "config":
                (folder / package / entry.name).symlink_to(entry)
    config = folder / "observer" / "config"
    shutil.copytree(ROOT / "observer" / "config", config, ignore=shutil.ignore_patterns("__pycache__"))
    heat = config / "effects" / "heat.py"
    heat.write_text(f"{heat.read_text(encoding='utf-8')}\n\n{IN_LIBRARY}\n", encoding="utf-8")
    return folder


@pytest.mark.slow
@pytest.mark.parametrize(
    ("kind", "key", "strength"), [("hanging_load", "fraction", "0.4"), ("telescopic:Cover", "heated", "5.0")]
)
def test_an_effect_added_as_the_page_says_is_found_by_a_search(
    kind: str, key: str, strength: str, cover: Path
) -> None:
    assert kind not in KINDS
    folder = extended(cover / "extended")
    done = subprocess.run(
        [sys.executable, "-c", FOLLOWED, kind, key, strength],
        cwd=folder,
        env=os.environ | {"PYTHONPATH": f"{folder}:{cover}"},
        capture_output=True,
        text=True,
        timeout=500,
    )
    assert done.returncode == 0, done.stderr
    tried, found = done.stdout.splitlines()
    assert f"{kind} at bearing.l" in tried
    named, *effect, value = found.split()
    assert [named, *effect] == ["named", kind, "bearing.l"]
    assert float(value) == pytest.approx(float(strength), rel=0.05)
