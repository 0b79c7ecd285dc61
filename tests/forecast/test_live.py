"""The forecaster beside a loop: what it is handed, it publishes as a document, in a thread of its own."""

from __future__ import annotations

import json
import threading
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest

import observer
from campaigns.forecast.warming import warming
from observer.align.aligner import frames_of_log
from observer.errors import LogError
from observer.estimate.checkpoint import Snapshot
from observer.estimate.pipeline import MachineModel
from observer.files.logs import Log
from observer.files.writer import write_log
from observer.service.forecasting import Forecaster, is_wanted
from observer.service.observers import Step
from tests.learning.cover import log_of
from tests.learning.machines import CONFIG, Rough, config_of, day, draw

pytestmark = pytest.mark.system
SCHEMA = {
    "time_s", "instance", "quality", "reason", "program", "at_s", "position_m", "temperature_degC", "sigma_K",
    "error_um", "error_sigma_um", "settled_degC", "settled_sigma_K", "settled_error_um",
    "settled_error_sigma_um", "settled_at_s", "settled_between_s", "settles_within_um",
}  # fmt: skip


def morning() -> Log:
    return log_of(day(draw(1, 3, Rough()), 1, 3, "a"))


def published(rows: int) -> dict[str, Any]:
    """What a service publishes that has run for so many rows."""
    config = config_of(CONFIG, "\n[forecast]\nperiod_s = 5.0\n")
    machine = MachineModel.of(config, learns=True)
    assert is_wanted(machine)
    documents, came = list[Mapping[str, Any]](), threading.Event()

    def publish(document: Mapping[str, Any]) -> None:
        documents.append(document)
        came.set()

    forecaster, pipeline = Forecaster(machine, "abc", publish), machine.pipeline(machine.estimator())
    frames = next(iter(frames_of_log(morning(), machine.plan, rows)))
    block = pipeline.step(frames)
    snapshot = Snapshot(float(block.time_s[-1]), *pipeline.snapshot())
    forecaster.follow(Step(frames, pipeline.inputs, block, now_s=0.0, snapshot=lambda: snapshot))
    forecaster.begin()
    assert came.wait(60.0)
    forecaster.finish(None)
    found: dict[str, Any] = json.loads(json.dumps(documents[0], allow_nan=False))
    return found


def test_a_running_service_publishes_what_comes() -> None:
    found = published(1800)
    assert set(found) == SCHEMA
    assert (found["instance"], found["reason"], len(found["at_s"])) == ("abc", None, 61)
    assert found["program"]["kind"] == "cycle"


def test_in_the_first_minute_it_says_why_there_is_none() -> None:
    found = published(30)
    assert set(found) == SCHEMA
    assert "wait for a minute of operation" in found["reason"]
    assert found["quality"] != "good"


def test_a_forecaster_is_off_where_it_is_switched_off() -> None:
    assert not is_wanted(MachineModel.of(config_of(CONFIG, "\n[forecast]\nenabled = false\n")))


def files(folder: Path, rows: int) -> tuple[Path, Path]:
    log = morning()
    columns = {c: log.values[:rows, i] for i, c in enumerate(log.channels)}
    write_log(folder / "log.csv", log.time_s[:rows], columns)
    (folder / "machine.toml").write_text(CONFIG, encoding="utf-8")
    return folder / "log.csv", folder / "machine.toml"


def test_a_log_and_a_program_are_forecast_into_files(tmp_path: Path) -> None:
    log, config = files(tmp_path, 1500)
    forecast = observer.load(config).forecast(log, program=log, hours=0.5)
    forecast.write(tmp_path / "out")
    assert {f.name for f in (tmp_path / "out").iterdir()} == {"forecast.csv", "forecast.json", "forecast.png"}
    found = json.loads((tmp_path / "out" / "forecast.json").read_text(encoding="utf-8"))
    assert set(found) == SCHEMA
    assert found["program"]["kind"] == "given"
    assert found["at_s"][-1] - found["time_s"] == pytest.approx(1800.0, abs=10.0)  # to a bin
    assert "warmest" in forecast.sentences[0]


def test_a_log_of_a_warm_up_says_where_it_settles_and_how_sure_that_is(tmp_path: Path) -> None:
    log = log_of(warming(draw(9001, 1, Rough()), 9001, 1))
    rows, columns = 1300, dict(zip(log.channels, log.values.T, strict=True))
    write_log(tmp_path / "log.csv", log.time_s[:rows], {c: v[:rows] for c, v in columns.items()})
    (tmp_path / "machine.toml").write_text(CONFIG, encoding="utf-8")
    forecast = observer.load(tmp_path / "machine.toml").forecast(tmp_path / "log.csv", hours=0.1)
    found = forecast.document
    places = len(found["position_m"])
    assert all(len(found[key]) == places for key in ("settled_degC", "settled_error_um"))
    assert min(found["settled_sigma_K"]) > 0.0
    low_s, high_s = found["settled_between_s"]
    assert low_s <= found["settled_at_s"] <= high_s
    assert forecast.sentences[1].startswith("It settles with ")


def test_a_log_that_is_too_short_is_refused_in_a_sentence(tmp_path: Path) -> None:
    log, config = files(tmp_path, 30)
    with pytest.raises(LogError, match=r"log\.csv: no forecast .* a minute of operation"):
        observer.load(config).forecast(log)
