"""What displacements say beside a search on the independent machine: found, or at least not heat."""

from __future__ import annotations

import json
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from observer.app import discover
from observer.discovery.displacement import _supported
from observer.report.wording import as_sentences
from tests.discovery.grown import EXPANSION_1_K, Moved, write_grown
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
    discovery, result = discover(config, logs, folder / "found", lambda *_: None, alone=True)
    assert "Displacements" in (folder / "found" / "report.html").read_text(encoding="utf-8")
    written: dict[str, Any] = json.loads((folder / "found" / "result.json").read_text(encoding="utf-8"))
    assert written["displacements"] == result["displacements"]
    return result, " ".join(as_sentences(discovery, result))


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


def test_a_screw_that_expands_more_than_configured(tmp_path: Path) -> None:
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


@pytest.mark.nightly
def test_a_bed_that_grows_with_the_air(tmp_path: Path) -> None:
    result, _ = found(tmp_path, Moved(bed_1_K=11e-6), air_K=2.0)
    assert result["verdict"] == "none"
    assert named(result, 11e-6) == "bed.expansion_1_K"


@pytest.mark.nightly
def test_a_drift_of_one_probe(tmp_path: Path) -> None:
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
