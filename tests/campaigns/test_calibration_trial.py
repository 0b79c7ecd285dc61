"""The trial of calibrations: its faults, and what it counts as worse."""

from __future__ import annotations

import numpy as np
import pytest

from campaigns.first_day.calibration import FAULTS, MOST_WORSE, summary, with_fault

TIME_s = np.arange(0.0, 2400.0, 0.5)
LOG = {
    "time_s": TIME_s,
    "nut_body_degC": 22.0 + TIME_s / 400.0,
    "ambient_degC": np.full(len(TIME_s), 22.0),
    "nut_position_m": np.full(len(TIME_s), 0.3),
}


@pytest.mark.parametrize(
    ("fault", "column"),
    [("position", "nut_position_m"), ("stuck", "nut_body_degC"), ("loose", "nut_body_degC")],
)
def test_a_fault_begins_late_and_is_in_one_column(fault: str, column: str) -> None:
    faulty = with_fault(fault, LOG)
    changed = {name for name in LOG if not np.array_equal(faulty[name], LOG[name])}
    assert changed == {column}
    first = int(np.flatnonzero(faulty[column] != LOG[column])[0])
    assert TIME_s[first] >= 0.4 * TIME_s[-1]
    assert LOG["nut_body_degC"][-1] == 22.0 + TIME_s[-1] / 400.0


def test_only_what_was_written_and_is_clearly_worse_counts() -> None:
    names = ("K", "um", "replay_um")
    row = {f"before_{name}": "1.0" for name in names} | {"fault": FAULTS[0]}
    worse, better = ({f"after_{name}": f"{value}" for name in names} for value in (1.01 * MOST_WORSE, 0.5))
    rows = [row | worse | {"written": "1"}, row | better | {"written": "1"}, row | worse | {"written": "0"}]
    last = summary(rows).splitlines()[-1]
    assert last.split("|")[0].split() == ["all", "3", "2"]
    assert last.split("|")[1].split()[0] == "1"
