"""What a service published, read from Python by time."""

from __future__ import annotations

import numpy as np
import pytest

import observer
from tests.record.lived import BEGIN_S
from tests.record.made import write_steps

TIME_S = BEGIN_S + 0.5 * np.arange(100)


@pytest.mark.parametrize("is_packed", [True, False])
def test_the_steps_of_a_span_come_as_a_table(tmp_path, is_packed):
    write_steps(tmp_path, "lathe-z", TIME_S, is_packed, t1_degC=20.0 + np.arange(100))
    steps = observer.past(tmp_path)
    assert steps.name == "lathe-z"
    assert steps.span_s == (TIME_S[0], TIME_S[-1])
    table = steps.table(TIME_S[10], TIME_S[12])
    assert table.to_pydict() == {"time_s": [*TIME_S[10:12]], "t1_degC": [30.0, 31.0]}
    table = steps.table(signals=("heat_nut_W", "quality"), every_s=10.0)
    assert table.column_names == ["time_s", "heat_nut_W", "quality"]
    np.testing.assert_array_equal(table.column("time_s"), TIME_S[::20])


def test_an_axis_is_named_where_there_are_several_and_a_missing_one_is_an_error(tmp_path):
    with pytest.raises(observer.ConfigError, match="run a service that records there"):
        observer.past(tmp_path)
    for name in ("lathe-z", "lathe-x"):
        write_steps(tmp_path, name, TIME_S, t1_degC=20.0)
    assert observer.past(tmp_path, "lathe-x").name == "lathe-x"
    with pytest.raises(observer.ConfigError, match="name one of lathe-x, lathe-z"):
        observer.past(tmp_path)
    with pytest.raises(observer.ConfigError, match="of mill; name one of"):
        observer.past(tmp_path, "mill")
