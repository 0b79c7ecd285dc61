"""What displacements say beside a search on the independent machine: found, or at least not heat."""

from __future__ import annotations

import json
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from observer import discover
from observer.config.machine import Config
from observer.discovery.displacement import _supported, displacements_of
from observer.frames import FrameBlock
from observer.installation import parse
from observer.model.build import build_plant
from observer.model.drive import Drive
from tests.discovery.grown import EXPANSION_1_K, Moved, write_grown
from tests.logs.machines import table
from tests.logs.simulated import frames, run_model
from tests.truth.machine.effects import Effect
from tests.truth.machine.generate import Case

SEED = 4300  # thresholds were set on seeds 5 to 7
TURNING = (Effect("speed_convection", None, {"gain": 0.18}),)
EXPANDED = Moved(expansion=0.15)


def found(
    folder: Path, moved: Moved, effects: tuple[Effect, ...] = (), every_s: float = 10.0, **case: Any
) -> tuple[dict[str, Any], str]:
    """The result of a search in logs with probes, and what is said of it."""
    logs = write_grown(Case("grown", effects, SEED, **case), moved, folder / "logs", every_s)
    config = folder / "logs" / "config.toml"
    discovery = discover(config, logs, alone=True)
    result = discovery.write(folder / "found")
    assert "Displacements" in (folder / "found" / "report.html").read_text(encoding="utf-8")
    written: dict[str, Any] = json.loads((folder / "found" / "result.json").read_text(encoding="utf-8"))
    assert written["displacements"] == result["displacements"]
    return result, " ".join(discovery.sentences)


def named(result: dict[str, Any], true: float) -> str:
    """The one cause that is named, whose interval holds the true value."""
    said = result["displacements"]
    assert said["verdict"] == "named"
    (cause,) = said["causes"]
    low, high = cause["ci95"]
    assert low <= true <= high
    for error in said["per_sensor"].values():
        assert error["after_rms_um"] < 1.5 * error["floor_rms_um"]
    return str(cause["key"])


def test_a_screw_that_expands_more_than_configured_is_named_by_its_expansion(tmp_path: Path) -> None:
    """No heat is made up for it."""
    result, said = found(tmp_path, EXPANDED)
    assert result["verdict"] == "none"
    assert named(result, 1.15 * EXPANSION_1_K) == "screw.expansion_1_K"
    assert "The displacements show screw.expansion_1_K" in said
    assert "[calibrate] free" in result["next"]["text"]


def test_where_nothing_is_hidden_all_is_explained_by_a_probing_each_quarter_of_an_hour(
    tmp_path: Path,
) -> None:
    result, said = found(tmp_path, Moved(), every_s=900.0)
    assert (result["verdict"], result["displacements"]["verdict"]) == ("none", "explained")
    assert "explains the displacements" in said


@pytest.mark.nightly
def test_a_knock_is_neither_heat_nor_anything_else_that_is_known(tmp_path: Path) -> None:
    result, _ = found(tmp_path, Moved(knock_um=8.0))
    assert (result["verdict"], result["displacements"]["verdict"]) == ("none", "unknown")


@pytest.mark.parametrize(
    ("without_um", "with_um", "said"), [(4.0, 1.0, True), (1.0, 4.0, False), (1.0, 1.1, None)]
)
def test_displacements_speak_for_or_against_a_name(
    without_um: float, with_um: float, said: bool | None
) -> None:
    def seen(error_um: float) -> Any:
        return SimpleNamespace(
            evidence=SimpleNamespace(proof=None), noise_um=0.3, beyond_um=error_um, causes=lambda: (),
            rms_um=lambda beyond_um, _rows: beyond_um,
        )  # fmt: skip

    assert _supported(seen(without_um), seen(with_um), with_um) is said  # type: ignore[arg-type]


PROBE = {"name": "probe", "kind": "displacement", "channel": "probe_um", "position_m": 0.35, "noise_um": 0.5}


def on_a_bed(config: Config, bed_1_K: float, seed: int) -> FrameBlock:
    """Two hours in air that begins 3 K above the probe's reference of 20 °C, a row every 5 s."""
    rng, time_s = np.random.default_rng(seed), np.arange(0.0, 7200.0, 5.0)
    air_degC = 20.0 + 3.0 * np.cos(time_s / 1500.0 * (1.0 + 0.2 * seed))
    columns = {
        "heater_W": np.where((time_s > 600.0) & (time_s < 4000.0), 15.0, 0.0),
        "n_rpm": np.where((time_s > 2400.0) & (time_s < 5400.0), 1000.0, 0.0),
        "air_degC": air_degC,
    } | {s.channel: np.full_like(time_s, 23.0) for s in config.sensor}
    plant = build_plant(config)
    _, rows = run_model(plant, Drive(config, plant), frames(config, time_s, columns), 23.0)
    for i, s in enumerate(config.sensor):
        columns[s.channel] = rows[:, i] + s.noise * rng.standard_normal(len(time_s))
    columns["probe_um"] -= 1e6 * bed_1_K * 0.35 * (air_degC - 20.0) - rng.standard_normal()
    return frames(config, time_s, columns)


@pytest.mark.parametrize("before", [None, 3e-6])
def test_a_bed_is_as_large_as_at_the_reference_temperature(before: float | None) -> None:
    """Its zero is known to 1 µm, and the air began a bed's 12 µm off the reference."""
    made = table(ambient={"channel": "air_degC"}, output={"reference_degC": 20.0})
    made["screw"]["expansion_1_K"] = EXPANSION_1_K
    made["sensor"].append(PROBE | {"zero_um": 1.0})
    config = parse(made)
    logs = [[on_a_bed(config, 11e-6, seed)] for seed in (1, 2, 3)]
    if before is not None:
        config = parse(made | {"bed": {"expansion_1_K": before, "channel": "air_degC"}})
    verdict: Any = SimpleNamespace(kind="none", fit=SimpleNamespace(config=config))
    said = displacements_of(config, logs, verdict, verdict.fit)
    assert said is not None
    assert said.verdict == "named"
    (cause,) = said.causes
    assert (cause.key, cause.before) == ("bed.expansion_1_K", before or 0.0)
    assert cause.ci95[0] < 11e-6 < cause.ci95[1] < 13e-6
    # where there is no [bed] there is none to write into
    assert said.values == ({} if before is None else {"bed.expansion_1_K": cause.value})


@pytest.mark.nightly
def test_a_bed_that_grows_with_the_air_is_named_by_its_expansion(tmp_path: Path) -> None:
    result, _ = found(tmp_path, Moved(bed_1_K=11e-6), air_K=2.0)
    assert result["verdict"] == "none"
    assert named(result, 11e-6) == "bed.expansion_1_K"


@pytest.mark.nightly
def test_the_drift_of_one_probe_is_named_and_is_no_heat(tmp_path: Path) -> None:
    result, _ = found(tmp_path, Moved(drift_um_h=4.0))
    assert result["verdict"] == "none"
    assert named(result, 4.0) == "drift of probe_500"


@pytest.mark.nightly
def test_an_effect_is_named_with_their_support_beside_what_moves_the_axis(tmp_path: Path) -> None:
    result, said = found(tmp_path, EXPANDED, TURNING)
    assert [e["kind"] for e in result["effects"]] == ["speed_convection"]
    assert named(result, 1.15 * EXPANSION_1_K) == "screw.expansion_1_K"
    assert result["displacements"]["supports"] is True
    assert "they support the name" in said
    assert "expansion_1_K = 1.3" in (tmp_path / "found" / "config.toml").read_text(encoding="utf-8")
