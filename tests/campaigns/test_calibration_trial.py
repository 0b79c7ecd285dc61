"""The trial of calibrations: what it counts as worse."""

from __future__ import annotations

from campaigns.first_day.calibration import FAULTS, MOST_WORSE, summary


def test_only_what_was_written_and_is_clearly_worse_counts() -> None:
    names = ("K", "um", "replay_um")
    row = {f"before_{name}": "1.0" for name in names} | {"fault": FAULTS[0]}
    worse, better = ({f"after_{name}": f"{value}" for name in names} for value in (1.01 * MOST_WORSE, 0.5))
    rows = [row | worse | {"written": "1"}, row | better | {"written": "1"}, row | worse | {"written": "0"}]
    last = summary(rows).splitlines()[-1]
    assert last.split("|")[0].split() == ["all", "3", "2"]
    assert last.split("|")[1].split()[0] == "1"
