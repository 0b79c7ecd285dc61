"""Forecasts of machines whose laws give more heat the warmer they are."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import tomlkit

from observer import LogError, Machine
from tests.fit.test_configured import TEXT, truth


def machine_with(**text: str) -> Machine:
    """The machine of the finite volumes, with parts of its configuration replaced."""
    fade = {"kind": "friction_fade", "target": "nut", "per_K": float(text.pop("per_K", "0"))}
    changed = TEXT
    for before, after in text.items():
        changed = changed.replace(before, f"{before} = {after} #")
    return Machine.of_text(changed + (tomlkit.dumps({"effect": [fade]}) if fade["per_K"] else ""))


LOG = {name: column[:1500:5] for name, column in truth(1).items()}


@pytest.mark.parametrize(
    "text", [{"per_K": "-0.05"}, {"per_K": "-0.01"}, {"torque_Nm": "1000.0"}], ids=["steep", "slow", "hot"]
)
def test_a_forecast_beyond_all_limits_is_refused_with_its_cause(text: dict[str, str]) -> None:
    with pytest.raises(LogError, match=r"no forecast from its end: .* beyond 1000 °C; check .*heat laws"):
        machine_with(**text).forecast(LOG, hours=24.0)


def test_a_forecast_that_only_settles_nowhere_leaves_that_out(tmp_path: Path) -> None:
    forecast = machine_with(per_K="-0.005").forecast(LOG, hours=0.1)
    forecast.write(tmp_path)
    document = json.loads((tmp_path / "forecast.json").read_text(encoding="utf-8"))
    assert document["settled_degC"] is None
    assert np.isfinite(np.array(document["temperature_degC"])).all()
    assert not any("nan" in sentence or "inf" in sentence for sentence in forecast.sentences)
