"""Times that are no seconds are refused, and words that stand for missing values are counted."""

import math

import numpy as np
import pyarrow as pa
import pytest
from pyarrow import parquet

from observer.errors import LogError
from observer.files.logs import read_log
from observer.tables.logs import Logs

MOST_S = Logs().rows_apart_s


def _log(folder, times, cells=None):
    path = folder / "log.csv"
    cells = ["20.5"] * len(times) if cells is None else cells
    path.write_text("time_s,t1_degC\n" + "".join(f"{t},{c}\n" for t, c in zip(times, cells, strict=True)))
    return path


@pytest.mark.parametrize(
    ("since", "unit", "divide"),
    [(1.7e12, "milliseconds", "1e3"), (1.7e15, "microseconds", "1e6"), (1.7e18, "nanoseconds", "1e9")],
)
def test_an_epoch_in_another_unit_is_named(tmp_path, since, unit, divide):
    path = _log(tmp_path, [int(since) + i * int(since / 1.7e9) for i in range(5)])
    with pytest.raises(LogError, match=f"{path.name}: time_s .*looks like {unit} since.*column by {divide}$"):
        read_log(path)


def test_rows_a_second_apart_in_milliseconds_are_rejected_unless_configured(tmp_path):
    path = _log(tmp_path, range(0, 60_000, 1000))
    with pytest.raises(LogError, match=r"log\.csv: by time_s .*16\.7 min apart.*lasts 16\.4 h.*rows_apart_s"):
        read_log(path, rows_apart_s=MOST_S)
    assert len(read_log(path, rows_apart_s=1500.0)) == 60  # what the sentence proposes


@pytest.mark.parametrize("apart_s", [0.01, 1.0, 60.0, 300.0])
def test_what_recorders_really_write_is_read_though_pauses_are_long(tmp_path, apart_s):
    times = [1.7e9 + apart_s * i + (0 if i < 15 else 3e6) for i in range(40)]
    assert len(read_log(_log(tmp_path, times), rows_apart_s=MOST_S)) == 40


def test_words_that_mean_missing_are_counted_by_column(tmp_path):
    cells = ["inf", "NULL", "20", "", "NaN", " nan ", "NULL", "-inf", "21", "NA"]
    log = read_log(_log(tmp_path, range(10), cells))
    (words,) = log.words
    assert (words.column, words.cells) == ("t1_degC", 7)
    assert set(words.texts) == {"inf", "NULL", "NaN", "nan", "-inf", "NA"}
    assert words.text.startswith("channel t1_degC: 7 cells say NULL, ")
    assert not np.isfinite(log.values[[0, 1, 3, 4, 5, 6, 7, 9], 0]).any()


def test_empty_cells_and_names_that_hold_a_word_are_nothing_to_report(tmp_path):
    path = tmp_path / "log.csv"
    path.write_text("time_s,nan,inf_degC,note\n0,,20,NaN\n1,3,,NULL\n")
    assert read_log(path, ["nan", "inf_degC"]).words == ()


def test_infinite_numbers_in_parquet_are_counted(tmp_path):
    values = pa.array([1.0, math.inf, None, -math.inf])
    parquet.write_table(pa.table({"time_s": [0, 1, 2, 3], "t1_degC": values}), tmp_path / "log.parquet")
    (words,) = read_log(tmp_path / "log.parquet").words
    assert (words.column, words.cells, words.texts) == ("t1_degC", 2, ("inf",))
