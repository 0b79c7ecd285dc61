"""The examples in config/ can be used as they are."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from observer import installation
from observer.bus.codec import config_json
from observer.report import check

ROOT = Path(__file__).parents[2]
EXAMPLES = sorted((ROOT / "config").glob("*.toml"))


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda p: p.name)
def test_every_example_loads(path: Path) -> None:
    loaded = installation.load(path)
    heats = sum(s.estimate and not s.follows for s in loaded.source)
    assert len(loaded.sensor) >= heats, "fewer sensors than heats: constant heats cannot all be observed"


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda p: p.name)
def test_what_a_service_answers_for_its_configuration_is_one(path: Path) -> None:
    loaded = installation.load(path)
    answered = json.loads(config_json(loaded, "ab12cd34"))
    assert installation.parse(answered["config"]).digest == answered["hash"] == loaded.digest


def test_kim_uses_the_diffusivity_of_the_table() -> None:
    screw = installation.load(ROOT / "config" / "kim-screw.toml").screw
    diffusivity_m2_s = screw.conductivity_W_mK / (screw.density_kg_m3 * screw.specific_heat_J_kgK)
    assert diffusivity_m2_s == pytest.approx(1.67e-5, rel=1e-4)  # the file gives c with five digits


@pytest.mark.parametrize("name", ["li-network.toml", "yu-dual-drive.toml"])
def test_the_heats_of_a_network_are_observable(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    for table in ("tolerances", "detectable"):  # they take most of the time, and say nothing of this
        monkeypatch.setattr(check, table, lambda _config: {})
    found = check.findings(installation.load(ROOT / "config" / name))
    assert all(gain is not None and gain < 20.0 for gain in found["noise_gain_W_K"].values())
    assert not any("do not serve" in w or "the step is not exact" in w for w in found["warnings"])


# The node balances of Yu et al.: who exchanges heat with whom; S the screw, I the air in the nut, A outside.
YU_LINKS = """
5-6 6-7 7-8 5-9 6-10 7-11 8-12 9-10 10-11 11-12 10-14 11-15 13-14 14-15 13-16 14-17 15-18 16-17 17-18
9-I 13-I I-A
12-A 16-A 17-A 18-A 5-S 6-S 7-S 8-S
"""


def test_the_layout_of_yu_is_the_papers() -> None:
    loaded = installation.load(ROOT / "config" / "yu-dual-drive.toml")
    short = {"air_inside": "I", "ambient": "A", "nut": "S"} | {f"n{i}": str(i) for i in range(5, 19)}
    linked = {frozenset(short[end] for end in link.between) for link in loaded.link}
    assert linked == {frozenset(pair.split("-")) for pair in YU_LINKS.split()}
    assert len(linked) == len(loaded.link)
    heated = {name for source in loaded.source for name in source.nodes}
    assert heated == {"n5", "n6", "n7", "n8", "n10", "n11"}
