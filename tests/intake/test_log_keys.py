"""The keys of `[log]` for logs without a clock and for missing values."""

from __future__ import annotations

import numpy as np
import pytest
from pydantic import ValidationError

from observer.config.logs import Logs
from observer.library.given import recorded
from tests.intake.rod import rod


@pytest.mark.parametrize(
    ("table", "words"),
    [
        ({"every_s": 0.0}, "greater than 0"),
        ({"every_s": 1e6}, "less than or equal to 86400"),
        ({"every_s": "1 min"}, "every_s"),
        ({"every_s": 60.0, "time": "t"}, "every_s is for a log without a clock"),
        ({"missing": [""]}, "at least 1 character"),
        ({"missing": 5}, "missing"),
    ],
)
def test_a_value_that_makes_no_sense_is_refused(table, words):
    with pytest.raises(ValidationError, match=words):
        Logs.model_validate(table)


@pytest.mark.parametrize("name", ["time_s,t1_degC", "time [s];t1_degC"])
def test_words_and_numbers_of_the_key_are_missing_and_counted(tmp_path, name):
    mark = name[-8]
    cells = ["21.0", "NoSensor", "22.0", "-88", "-88.0", "23.0", "OVLD", "-9.9E+37", "9.91E37", "21.0"] * 2
    rows = [f"{i}{mark}{cell}" for i, cell in enumerate(cells)]
    path = tmp_path / "log.csv"
    path.write_text("\n".join([name.replace(";", mark), *rows]) + "\n")
    log = recorded(path, rod(tmp_path, {"missing": ["NoSensor", "-88"]}, {}))
    assert np.isfinite(log["t1_degC"]).sum() == 8
    assert sum(words.cells for words in log.words) == 12


def test_a_row_left_out_of_a_log_without_a_clock_still_takes_its_time(tmp_path):
    rows = ["Lager;Mutter", *(f"{21 + i / 100:.2f};22.0" for i in range(40))]
    rows[11] = "21.10"
    path = tmp_path / "log.txt"
    path.write_text("\n".join(rows) + "\n")
    log = recorded(path, rod(tmp_path, {"every_s": 5.0}, {"t1_degC": "Lager"}))
    assert log.time_s.tolist() == [5.0 * i for i in range(40) if i != 10]
    assert any("line 12" in doubt for doubt in log.doubts)


@pytest.mark.parametrize(
    ("begin", "missing"),
    [
        ([85.0, 85.0, 21.0, 21.1], [0, 1]),
        ([83.9, 84.4, 85.0, 85.5], []),
        ([21.0, -127.0, 21.1, 21.1], [1]),
        ([21.0, 21.0, 85.0, 85.0], [2, 3]),
        ([84.0, 85.0, 85.0, 84.0], []),
    ],
)
def test_a_sensors_code_is_missing_only_where_no_value_leads_to_it(tmp_path, begin, missing):
    last = begin[-1] if begin[-1] not in (85.0, -127.0) else begin[0]
    values = [*begin, *(last + 0.1 * i for i in range(1, 40))]
    path = tmp_path / "log.csv"
    path.write_text("time_s,t1_degC\n" + "".join(f"{i},{v:.2f}\n" for i, v in enumerate(values)))
    log = recorded(path, rod(tmp_path, {}, {}))
    assert np.flatnonzero(np.isnan(log["t1_degC"])).tolist() == missing
