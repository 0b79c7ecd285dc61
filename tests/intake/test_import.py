"""`observer import` makes a log of files as they are after one question at most; alone it does not guess."""

from __future__ import annotations

import tomllib

import numpy as np
import pytest

from observer.errors import LogError
from observer.files.logs import read_log
from observer.intake.reading import read_channels
from tests.intake.machine import CONFIG, assert_is, configured, truth
from tests.intake.rod import import_file
from tests.intake.writers import german, measurement, mtconnect, waveforms, workbook

WRITERS = {
    "run.xlsx": workbook,
    "lauf.csv": lambda path, was: path.write_bytes(german(was).encode("cp1252")),
    "run.mf4": measurement("4.10"),
    "run.tdms": waveforms,
    "agent.csv": lambda path, was: path.write_text(mtconnect(was)),
}


@pytest.mark.parametrize("name", WRITERS)
def test_a_strangers_file_becomes_a_log_after_one_answer(tmp_path, name):
    was, path, out = truth(), tmp_path / name, tmp_path / "log.parquet"
    WRITERS[name](path, was)
    zone = "Europe/Berlin" if name == "lauf.csv" else "UTC"
    found = import_file(path, configured(tmp_path), timezone=zone)
    found.write(out, agreed=True)
    log = read_log(out)
    assert set(log.channels) == set(configured(tmp_path).channels)
    if name != "agent.csv":
        assert_is(log, was, apart=6e-6)
    table = tomllib.loads(found.table)
    assert set(table) == {"log"}
    direct = read_channels(path, configured(tmp_path, "\n" + found.table + "\n"))
    np.testing.assert_array_equal(direct.values, found.log.values)


def test_a_doubtful_log_is_rejected_where_nobody_can_answer(tmp_path):
    path, out = tmp_path / "lauf.csv", tmp_path / "log.parquet"
    path.write_bytes(german(truth()).encode("cp1252"))
    with pytest.raises(LogError) as caught:
        import_file(path, configured(tmp_path)).write(out)
    message = str(caught.value)
    assert "[log.columns] t1_degC" in message
    assert "Temp. Lager" in message
    assert "screw_speed_rpm:" not in message  # its name and unit leave no doubt
    assert not out.exists()
    columns = {"t1_degC": "Temp. Lager", "t2_degC": "Temp. Mutter"}
    import_file(path, configured(tmp_path), columns=columns, timezone="Europe/Berlin").write(out)
    assert_is(read_log(out), truth(), apart=6e-6)


def test_fahrenheit_that_nobody_names_is_suspected(tmp_path):
    was, path = truth(), tmp_path / "log.csv"
    rows = ["time,t1,t2,nut position,screw speed,ambient"]
    for s, a, b, x, n, c in zip(
        was.time_s, was.t1_degC, was.t2_degC, was.nut_position_m, was.screw_speed_rpm, was.ambient_degC,
        strict=True,
    ):  # fmt: skip
        rows.append(f"{s},{1.8 * a + 32},{1.8 * b + 32},{1000 * x},{n},{1.8 * c + 32}")
    path.write_text("\n".join(rows))
    with pytest.raises(LogError) as caught:
        import_file(path, configured(tmp_path)).write(tmp_path / "log.parquet")
    message = str(caught.value)
    assert '"ambient" looks like °F' in message
    assert '"t1" may be in °F' in message
    assert '"nut position" looks like mm' in message
    assert 't1_degC = { column = "t1", unit = "degF" }' in message


def test_a_channel_without_a_column_is_named_with_what_there_is(tmp_path):
    path = tmp_path / "log.csv"
    path.write_text("time,t1 [degC],t2 [degC]\n" + "".join(f"{i},22,{22 + i / 9}\n" for i in range(20)))
    with pytest.raises(LogError, match="3 problems") as caught:
        import_file(path, configured(tmp_path)).write(tmp_path / "log.parquet")
    assert "[log.columns] screw_speed_rpm" in str(caught.value)


@pytest.mark.system
def test_the_command_writes_the_log_and_prints_the_table(tmp_path):
    import subprocess
    import sys

    (tmp_path / "m.toml").write_text(CONFIG)
    workbook(tmp_path / "run.xlsx", truth())
    words = ["import", "run.xlsx", "--config", "m.toml", "--output", "log.parquet", "--yes"]
    done = subprocess.run(
        [sys.executable, "-m", "observer", *words], cwd=tmp_path, capture_output=True, text=True, timeout=100
    )
    assert done.returncode == 0, done.stderr
    assert "240 rows over 358.5 s written to log.parquet" in done.stdout
    assert "[log]" in done.stdout
    assert_is(read_log(tmp_path / "log.parquet"), truth(), apart=6e-6)
