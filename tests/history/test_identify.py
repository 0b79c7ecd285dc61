"""The heat history's files: every column of the contract, complete or not there."""

import csv
import itertools
import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import observer
from observer.cli import app as cli
from observer.errors import LogError, UserError
from observer.files.logs import read_log
from observer.files.writer import write_log
from observer.history.history import MethodOptions
from observer.history.identify import heat_history
from observer.installation import load
from observer.library import heats
from observer.library.profiles import ReportGrid
from tests.reference.cases import config_of, point
from tests.truth.bar import Bar, End

SPINDLE = Path(__file__).parents[2] / "config" / "lathe-spindle.toml"
LATHE = Path(__file__).parents[2] / "config" / "li-lathe-axis.toml"


def _config(sensor_m=(0.1, 0.9), **tables):
    left, right = point("left", 0.0, initial_sigma_W=20.0), point("right", 1.0, initial_sigma_W=20.0)
    for source in (left, right):
        del source["power_channel"]
    return config_of(
        Bar(), [left, right], [0.0, 1.0], sensor_m=sensor_m, ends=(End(), End()),
        ambient={"temperature_degC": 20.0}, estimator={"period_s": 5.0}, model={"modes": 8}, **tables,
    )  # fmt: skip


def _log(path, rows=200, missing=()):
    rng = np.random.default_rng(2)
    values = 20.0 + 0.05 * rng.standard_normal((rows, 2)) + np.linspace(0, 4, rows)[:, None]
    values[list(missing)] = np.nan
    write_log(path, 5.0 * np.arange(rows), {"t1_degC": values[:, 0], "t2_degC": values[:, 1]})
    return path


def _identify(log, output, **options):
    heats = observer.Machine(_config(), b"").identify(log, **options)
    heats.write(output)
    return heats.summary


def test_a_heat_that_an_effect_adds_is_known_and_not_among_those_found(tmp_path):
    log = _log(tmp_path / "log.csv")
    config = _config(effect=[{"kind": "local_heat", "position_m": 0.5, "heat_W": 3.0}])
    summary = observer.Machine(config, b"").identify(log).summary
    assert set(summary["heat_mean_W"]) == {"left", "right"}


def test_what_is_not_known_is_an_empty_cell_and_the_summary_leaves_it_out(tmp_path):
    log = _log(tmp_path / "log.csv", missing=range(10))
    summary = _identify(log, tmp_path / "out")
    assert (tmp_path / "out" / "heat.csv").read_text().splitlines()[1] == "0,,,,"
    assert summary == json.loads((tmp_path / "out" / "summary.json").read_text())
    assert summary["rows"] == 200
    assert np.isfinite(list(summary["heat_mean_W"].values())).all()
    assert summary["residual_rms_K"]["t1"] == pytest.approx(0.05, rel=0.2)  # the noise that was put in


def test_a_log_without_any_value_leaves_nothing_behind(tmp_path):
    log = _log(tmp_path / "log.csv", missing=range(200))
    with pytest.raises(LogError, match=r"log\.csv: no sensor has a value .* check the sensors' channels"):
        _identify(log, tmp_path / "out")
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    "options",
    [
        {"method": "smoother"},
        {"method": "tikhonov"},
        {"method": "tikhonov", "order": 0, "parameter_choice": "ico", "seed": 3},
        {"method": "conjugate-gradient"},
        {"method": "conjugate-gradient", "gradient": "central-differences"},
    ],
    ids=lambda options: "-".join(str(value) for value in options.values()),
)
def test_every_method_writes_the_same_files_and_says_how_it_went(tmp_path, options):
    log = _log(tmp_path / "log.csv")
    beside_the_sources = _config(sensor_m=(0.0, 1.0))  # step by step diverges with sensors farther away
    heats = observer.Machine(beside_the_sources, b"").identify(log, **options)
    heats.write(tmp_path / "out")
    summary = heats.summary
    assert sorted(p.name for p in (tmp_path / "out").iterdir()) == ["heat.csv", "heat.png", "summary.json"]
    read = read_log(tmp_path / "out" / "heat.csv")
    assert read.channels == ("heat_left_W", "heat_left_sigma_W", "heat_right_W", "heat_right_sigma_W")
    np.testing.assert_array_equal(read.time_s, read_log(log).time_s)
    assert np.isfinite(read.values).all()
    assert summary["method"] == options["method"]
    assert options["method"] == "smoother" or summary["misfit"] > 0.0
    assert summary.items() >= {k: v for k, v in options.items() if k not in ("order", "seed")}.items()


def test_heats_that_diverge_are_an_error_and_nothing_is_written(tmp_path):
    """Five sensors that read each half second are reached by the bearings' heat only after many steps."""
    steps, config = 200, load(LATHE)
    time_s = 0.5 * np.arange(steps)
    rng, rise_K = np.random.default_rng(4), 30.0 * (1.0 - np.exp(-time_s / 1500.0))
    columns = {sensor.channel: 25.0 + rise_K + 0.1 * rng.standard_normal(steps) for sensor in config.sensor}
    columns |= {"nut_position_m": 0.3 + 0.2 * np.sin(time_s), "screw_speed_rpm": np.full(steps, 1200.0)}
    write_log(tmp_path / "log.csv", time_s, columns)
    options = ["--method", "conjugate-gradient", "--gradient", "central-differences"]
    command = [
        "identify",
        str(tmp_path / "log.csv"),
        "--config",
        str(LATHE),
        "--output",
        str(tmp_path / "out"),
    ]
    done = CliRunner().invoke(cli, [*command, *options])
    assert isinstance(done.exception, LogError), done.output
    assert re.search(
        r"log\.csv: conjugate-gradient has diverged: .*; use --method smoother", str(done.exception)
    )
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("damage", [np.inf, 1e200, 1e9])
@pytest.mark.parametrize("field", ["heat_W", "residual_K"])
def test_no_method_returns_heats_beyond_any_screw_or_worse_than_none(tmp_path, monkeypatch, damage, field):
    def diverging(*arguments):
        history = heat_history(*arguments)
        return replace(history, **{field: history.heat_W * 0.0 + damage})

    monkeypatch.setattr(heats, "heat_history", diverging)
    with pytest.raises(LogError, match="smoother has diverged"):
        _identify(_log(tmp_path / "log.csv"), tmp_path / "out")


@pytest.mark.parametrize("method", ["tikhonov", "conjugate-gradient"])
def test_uneven_steps_are_taken_by_every_method(tmp_path, method):
    log = _log(tmp_path / "log.csv")
    lines = log.read_text().splitlines()
    log.write_text("\n".join(lines[:50] + lines[60:]) + "\n")
    summary = _identify(log, tmp_path / "out", method=method)
    assert summary["rows"] == 190
    assert not summary["warnings"]


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        ({"regularisation": 2.0}, "--regularisation belongs to --method tikhonov, not smoother"),
        ({"method": "smoother", "order": 1}, "--order belongs to"),
        ({"method": "tikhonov", "gradient": "adjoint"}, "--gradient belongs to --method conjugate-gradient"),
        ({"method": "tikhonov", "regularisation": 1.0, "parameter_choice": "gcv"}, "give one of them"),
        ({"method": "tikhonov", "regularisation": -1.0}, "give a number above 0"),
        (
            {"method": "conjugate-gradient", "gradient": "central-differences", "order": 1},
            "leave out --order",
        ),
    ],
)
def test_options_that_contradict_each_other_are_refused(options, sentence):
    with pytest.raises(UserError, match=sentence):
        MethodOptions(**options).check()


def test_a_report_has_temperatures_heats_and_errors_by_time_and_place(tmp_path):
    """Four times five minutes apart, 21 places 50 mm apart, with what estimates and heats say there."""
    log = _log(tmp_path / "log.csv", rows=250)
    result = observer.Machine(_config(), b"").identify(log, report=ReportGrid(0.05, 300.0))
    result.write(tmp_path / "out")
    assert (tmp_path / "out" / "report.png").read_bytes()[:4] == b"\x89PNG"
    with (tmp_path / "out" / "report.csv").open(newline="") as file:
        rows = [{key: float(value or "nan") for key, value in row.items()} for row in csv.DictReader(file)]
    assert [row["time_s"] for row in rows[::21]] == [300.0, 600.0, 900.0, 1200.0]
    assert [row["position_m"] for row in rows[:21]] == pytest.approx(np.linspace(0.0, 1.0, 21))
    heats = read_log(tmp_path / "out" / "heat.csv")
    left = heats.values[60, heats.channels.index("heat_left_W")]
    assert rows[0]["heat_left_W"] == left
    assert all(row["field_sigma_K"] > 0.0 for row in rows)
    late = rows[-21:]
    assert late[2]["field_degC"] == pytest.approx(20.0 + 4.0 * 1200.0 / 1245.0, abs=0.2), "where t1 sits"
    growth_um = [
        1e6 * Bar().expansion_1_K * 0.05 * (0.5 * (a["field_degC"] + b["field_degC"]) - 20.0)
        for a, b in itertools.pairwise(late)
    ]
    assert late[-1]["error_um"] == pytest.approx(sum(growth_um), rel=0.05)
    assert result.summary["rows"] == 250


def test_the_command_lists_the_files_of_a_report(tmp_path):
    columns = {sensor.channel: np.full(200, 25.0) for sensor in load(SPINDLE).sensor}
    write_log(tmp_path / "log.csv", 10.0 * np.arange(200), columns)
    command = [
        "identify",
        str(tmp_path / "log.csv"),
        "--config",
        str(SPINDLE),
        "--output",
        str(tmp_path / "out"),
    ]
    done = CliRunner().invoke(cli, [*command, "--every-m", "0.2"])
    assert done.exit_code == 0, done.exception
    names = done.stdout.splitlines()[-1].partition(": ")[2].split(", ")
    assert sorted(names) == sorted(path.name for path in (tmp_path / "out").iterdir())


def test_a_report_that_cannot_be_is_refused_in_one_sentence(tmp_path):
    log = _log(tmp_path / "log.csv")
    refused = ((ReportGrid(2.0), "--every-m 2: give between"), (ReportGrid(0.2, 0.0), "--every-min 0"))
    for report, sentence in refused:
        with pytest.raises(UserError, match=sentence):
            observer.Machine(_config(), b"").identify(log, report=report)
    config = tmp_path / "machine.toml"
    config.write_text("")  # nothing is read before
    command = ["identify", str(log), "--config", str(config), "--output", str(tmp_path / "out")]
    done = CliRunner().invoke(cli, [*command, "--every-min", "0"])
    assert str(done.exception) == "--every-min 0: give a number above 0"
    assert not (tmp_path / "out").exists()
