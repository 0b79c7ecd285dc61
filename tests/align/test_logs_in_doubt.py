"""Every command rejects an implausible log by file and column, and reports what it read as missing."""

import pytest

import observer
from observer.align.aligner import doubts, refuse_empty
from observer.errors import LogError
from observer.files.logs import read_log
from observer.installation import load
from tests.logs.machines import machine_text

CONFIG = machine_text(
    "bearing", ambient={"channel": "ambient_degC"}, sensor__1=None, sensor__0__noise_K=0.05, log={}
)
HEAD = "time_s,ambient_degC,speed_rpm,t1_degC"


@pytest.fixture
def config(tmp_path):
    path = tmp_path / "machine.toml"
    path.write_text(CONFIG)
    return path


def _log(folder, *, ambient="22", sensor="22.5", apart=1):
    path = folder / "log.csv"
    path.write_text(HEAD + "\n" + "".join(f"{i * apart},{ambient},1000,{sensor}\n" for i in range(700)))
    return path


def _replay(log, config, out):
    observer.load(config).replay(log)


def _identify(log, config, out):
    observer.load(config).identify(log)


def _simulate(log, config, out):
    observer.load(config).simulate(log)


def _calibrate(log, config, out):
    observer.load(config).calibrate([log])


def _discover(log, config, out):
    observer.load(config).discover([log])


def _forecast(log, config, out):
    return observer.load(config).forecast(log, hours=0.5)


COMMANDS = [_replay, _identify, _calibrate, _discover]


@pytest.mark.parametrize("command", COMMANDS)
def test_a_log_in_milliseconds_is_rejected(command, config, tmp_path):
    with pytest.raises(LogError, match=r"log\.csv: by time_s .*milliseconds"):
        command(_log(tmp_path, apart=1000), config, tmp_path / "out")


def test_it_is_read_where_the_configuration_says_so(config, tmp_path):
    config.write_text(CONFIG + "rows_apart_s = 1500.0\n")
    _replay(_log(tmp_path, apart=1000), config, tmp_path / "out")


@pytest.mark.parametrize("command", [*COMMANDS, _simulate])
@pytest.mark.parametrize("cell", ["", "NaN", "inf"])
def test_a_channel_without_any_value_is_rejected_by_its_name(command, cell, config, tmp_path):
    with pytest.raises(LogError, match=r'log\.csv: column "ambient_degC" never has a value'):
        command(_log(tmp_path, ambient=cell), config, tmp_path / "out")


@pytest.mark.parametrize("command", [_identify, _calibrate, _discover, _simulate, _forecast])
def test_air_in_another_unit_is_rejected_by_its_name_and_unit(command, config, tmp_path):
    """It counts as missing throughout, so that nothing else could be said of the log."""
    with pytest.raises(
        LogError,
        match=r"log\.csv: channel ambient_degC is implausible: 71\.6 .* looks like °F or tenths of °C;",
    ):
        command(_log(tmp_path, ambient="71.6"), config, tmp_path / "out")


def test_what_a_log_lacks_and_what_is_wrong_at_its_end_is_said_of_a_forecast_too(config, tmp_path):
    path = _log(tmp_path)
    head, *rows = path.read_text().splitlines()
    rows = [row.replace("22.5", f"{42 if i > 690 else 22}.{50 + i % 7}") for i, row in enumerate(rows)]
    rows[350:] = [row.replace(f"{350 + i},", f"{86750 + i},", 1) for i, row in enumerate(rows[350:])]
    rows[3] = rows[3].replace("22.53", "nan")
    path.write_text("\n".join([head, *rows]) + "\n")
    said = _forecast(path, config, tmp_path / "out").doubts
    (gap,) = [text for text in said if "no row" in text]
    assert gap.startswith("there is no row for 24 h after 349 s: ")
    assert any("t1_degC: 1 cell says nan" in text for text in said)
    assert any(text.startswith("t1 ") for text in said), "which stepped by 20 K"
    assert gap in observer.load(config).identify(path).summary["doubts"]


def test_a_sensor_may_have_been_away_in_a_recording_and_a_program_has_none(config, tmp_path):
    log = read_log(_log(tmp_path, sensor=""))
    with pytest.raises(LogError, match='"t1_degC"'):
        refuse_empty(log, load(config), sensors=True)
    refuse_empty(log, load(config), sensors=False)
    with pytest.raises(LogError, match='"t1_degC"'):
        _replay(log.path, config, tmp_path / "out")
    recording = tmp_path / "recording.csv"
    rows = "".join(f"{i},,1000,,0,\n{i}.5,,,,1,\n" for i in range(50))
    recording.write_text(f"{HEAD},step,flags\n" + rows)  # the air was away as well
    _replay(recording, config, tmp_path / "out")


def test_one_dead_sensor_of_two_is_reported_and_the_log_is_used(config, tmp_path):
    path, two = _log(tmp_path), load(config)
    second = two.sensor[0].model_copy(update={"name": "t2", "channel": "t2_degC"})
    two = two.model_copy(update={"sensor": (*two.sensor, second)})
    head, *rows = path.read_text().splitlines()
    path.write_text("\n".join([f"{head},t2_degC", *(f"{row}," for row in rows)]) + "\n")
    summary = observer.Machine(two, b"").replay(path).summary
    assert summary["doubts"] == [
        "channel t2_degC has no value in any row, so its sensor counts as missing throughout"
    ]
    assert summary["sensors"]["t2"]["quality"]["missing"] == summary["rows"]


def test_words_read_as_missing_are_reported_once_per_column_in_use(config, tmp_path):
    path = _log(tmp_path)
    rows = [f"{row},NaN" for row in path.read_text().splitlines()[1:]]
    rows[10:14] = [row.replace("22.5", "NULL") for row in rows[10:14]]
    path.write_text(f"{HEAD},note\n" + "\n".join(rows) + "\n")
    found = doubts(read_log(path), (), load(config))
    assert [text for text in found if "missing" in text] == [
        "channel t1_degC: 4 cells say NULL and were read as missing; check why the recorder wrote "
        "that, and leave missing cells empty"
    ]
    summary = observer.load(config).replay(path).summary
    assert sum("4 cells say NULL" in text for text in summary["doubts"]) == 1
    said = observer.load(config).simulate(path).doubts
    assert sum("4 cells say NULL" in text for text in said) == 1
