"""Results of a machine: their signals, files, pictures and sentences."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import observer
from observer.installation import load

RIG = Path(__file__).parents[1] / "data" / "rig"
CONFIG, LOG = RIG / "config.toml", RIG / "end_conduction-0.1" / "run_a.csv.gz"


@pytest.fixture(scope="module")
def machine() -> observer.Machine:
    return observer.load(CONFIG)


@pytest.fixture(scope="module")
def short(machine) -> dict[str, np.ndarray]:
    """The first twenty minutes of a log, as columns."""
    log = observer.read_log(LOG)
    rows = log.time_s < log.time_s[0] + 1200.0
    return {"time_s": log.time_s[rows], **{name: log[name][rows] for name in log.channels}}


@pytest.fixture(scope="module")
def short_file(short, tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("log") / "log"
    pd.DataFrame(short).to_parquet(path.with_suffix(".parquet"), index=False)
    return path.with_suffix(".parquet")


@pytest.fixture(scope="module")
def estimates(machine, short_file) -> observer.Estimates:
    return machine.replay(short_file)


@pytest.fixture(autouse=True)
def no_window() -> Iterator[None]:
    import matplotlib
    from matplotlib import pyplot

    matplotlib.use("agg")
    yield
    pyplot.close("all")


def test_the_columns_of_a_replay_are_its_signals(estimates, tmp_path):
    estimates.write(tmp_path / "library")
    header = (tmp_path / "library" / "estimates.csv").read_text().splitlines()[0].split(",")
    assert header == ["time_s", *estimates.signals]


@pytest.mark.parametrize("form", ["frame", "index", "dict", "log", "text"])
def test_a_log_is_a_path_a_table_or_columns(form, machine, short, short_file, estimates):
    frame = pd.DataFrame(short)
    given = {
        "frame": frame,
        "index": frame.set_index("time_s"),
        "dict": short,
        "log": observer.read_log(short_file),
        "text": str(short_file),
    }[form]
    found = machine.replay(given)
    assert found.to_arrow().equals(estimates.to_arrow())


def test_signals_have_names_units_and_places(estimates, machine):
    frame, cube = estimates.to_pandas(), estimates.to_xarray()
    assert frame.index.name == "time_s"
    assert list(frame.columns) == list(estimates.signals)
    field = estimates["field_50_degC"]
    assert np.array_equal(field, frame["field_50_degC"])
    assert np.array_equal(field, cube["field_degC"].sel(position_m=0.05).values)
    assert cube["field_degC"].dims == ("time_s", "position_m")
    assert cube["position_m"].attrs["units"] == "m"
    assert cube["error_sigma_um"].attrs["units"] == "um"
    assert cube["heat_nut_W"].attrs["units"] == "W"
    assert set(np.unique(estimates["quality_t1"])) <= {"good", "missing", "rejected", "stale", "excluded"}
    assert len(estimates) == len(estimates.time_s) == len(frame)
    with pytest.raises(KeyError, match=r"signals lists them"):
        estimates["heat_W"]


def test_a_result_is_drawn_and_shown(estimates):
    axes = estimates.plot()
    assert [ax.get_title(loc="left") for ax in axes][:2] == [
        "Heat entering the screw",
        "Temperature of the screw",
    ]
    page = estimates._repr_html_()
    assert "heat_nut_W" in page
    assert f"{np.nanmean(estimates['heat_nut_W']):.4g}" in page
    assert "replay of log.parquet" in repr(estimates)


def test_a_simulation_is_a_log_again(machine, short_file, short, tmp_path):
    run = machine.simulate(short)
    run.write(tmp_path, "a.csv")
    written = observer.read_log(tmp_path / "a.csv")
    assert all(np.array_equal(written[name], run[name], equal_nan=True) for name in run.signals)
    assert np.array_equal(run.last_degC, [run[s.channel][-1] for s in machine.config.sensor])
    found = machine.replay(run)
    # without noise nothing surprises: far below the 0.06 K of a reading
    assert found.summary["sensors"]["t1"]["innovation_rms_K"] < 0.02


def test_identified_heats_have_signals_and_a_picture(machine, short_file):
    heats = machine.identify(short_file)
    assert heats.signals[:2] == ("heat_nut_W", "heat_nut_sigma_W")
    assert len(heats.plot()) == 1 + len(machine.config.source)


def test_a_forecast_reaches_as_far_as_asked(machine, short_file):
    found = machine.forecast(short_file, hours=0.5)
    assert found.sentences[0].startswith("In 0.5 h")
    assert found.time_s[-1] - found.time_s[0] == pytest.approx(1800.0, abs=60.0)


def test_a_calibration_gives_a_machine(machine, short_file, tmp_path):
    found = machine.calibrate([short_file])
    found.write(tmp_path / "c")
    for key, value in found.values.items():
        low, high = value.ci95
        assert low <= value.value <= high
        assert value.unit
        assert key in repr(found)
    assert found.machine.config.digest == load(tmp_path / "c" / "config.toml").digest
    assert found.machine.config.digest != machine.config.digest


def test_a_machine_is_checked_and_has_a_state_space(machine):
    found = machine.check()
    assert found.usable
    assert found["modes"] > 0
    system = machine.state_space()
    names = machine.replay({"time_s": [0.0, 1.0], **_standing(machine)}).signals
    along = [name for name in system.output_labels if not name.startswith("sensor_")]
    assert set(along) <= {name.replace(".", "_") for name in names}
    assert system.output_labels[0] == "sensor_t1_degC"
    assert system.input_labels[:1] == ["heat_nut_W"]
    assert "ambient_degC" in system.input_labels
    # at rest in air of 20 °C the whole screw is at 20 °C
    settled = system.dcgain()[:, system.input_labels.index("ambient_degC")] * 20.0
    np.testing.assert_allclose(settled[: len(machine.config.sensor)], 20.0, rtol=1e-6)


def _standing(machine) -> dict[str, list[float]]:
    return {channel: [20.0 if channel.endswith("degC") else 0.2] * 2 for channel in machine.config.channels}


@pytest.mark.parametrize(
    ("given", "sentence"),
    [
        ({"t1_degC": [1.0]}, "log: has no time_s"),
        ({"time_s": [0.0, 1.0], "t1_degC": ["a", "b"]}, "does not hold numbers"),
        ({"time_s": [1.0, 0.0], "t1_degC": [1.0, 1.0]}, "row 2: time_s goes back"),
        ({"time_s": [0.0, 1.0], "t1_degC": [1.0]}, "one value a row"),
        ({"time_s": [0.0, 1.0], "t1_degC": [1.0, 1.0]}, "are missing; add them to the log"),
        (17, "a int is not a log"),
        ("none.csv", "none.csv: no such file"),
    ],
)
def test_an_invalid_log_is_a_sentence(given, sentence, machine):
    with pytest.raises(observer.LogError) as error:
        machine.replay(given)
    assert sentence in str(error.value)


def test_the_same_log_twice_is_not_a_second_run(machine, short):
    with pytest.raises(observer.LogError, match="holds the same as"):
        machine.calibrate([short, pd.DataFrame(short)])


def test_a_replay_that_is_killed_leaves_no_temporary_file(machine, short, tmp_path, monkeypatch):
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    names = []
    machine.replay(short, progress=lambda _done, _total: names.extend(tmp_path.iterdir()))
    assert names == []
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path / "none"))
    with pytest.raises(observer.LogError, match="or set TMPDIR to another folder"):
        machine.replay(short)
