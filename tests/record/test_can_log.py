"""A CAN recording replays like the live bus: the same readings, the same estimates."""

from __future__ import annotations

import csv
import math
from pathlib import Path

import can
import cantools
import pytest

from observer import Machine
from observer.errors import ConfigError, LogError
from observer.installation import Installation, parse
from tests.logs.machines import machine_table

DBC = """VERSION ""
BS_:
BU_: Rig
BO_ 256 Temperatures: 6 Rig
 SG_ T1 : 0|16@1- (0.01,0) [-50|150] "degC" Rig
 SG_ T2 : 16|16@1- (0.01,0) [-50|150] "degC" Rig
 SG_ Speed : 32|16@1+ (1,0) [0|6000] "rpm" Rig
"""


def _config(dbc: Path, *, with_driver: bool = True) -> Installation:
    channels = {
        channel: {"message": "Temperatures", "signal": signal}
        for channel, signal in (("t1_degC", "T1"), ("t2_degC", "T2"), ("speed_rpm", "Speed"))
    }
    driver = {
        "kind": "can", "interface": "virtual", "channel": "none", "dbc": str(dbc), "period_s": 0.5,
        "channels": channels,
    }  # fmt: skip
    return parse(machine_table("bearing", drivers={"axis": driver} if with_driver else {}))


def _recorded(path: Path, dbc: Path, seconds: float = 60.0, backwards: bool = False) -> None:
    database = cantools.database.load_file(dbc)
    with can.Logger(path) as writer:
        for k in range(int(seconds / 0.5)):
            data = database.encode_message(
                "Temperatures", {"T1": 20 + 0.02 * k, "T2": 20 + 0.002 * k, "Speed": 1500}
            )
            time_s = 1_700_000_000.25 + 0.5 * (k - 3 if backwards and k == 50 else k)
            writer(can.Message(timestamp=time_s, arbitration_id=256, is_extended_id=False, data=data))


@pytest.fixture
def dbc(tmp_path: Path) -> Path:
    path = tmp_path / "rig.dbc"
    path.write_text(DBC)
    return path


def test_every_frame_of_a_recording_reaches_the_estimator(tmp_path: Path, dbc: Path) -> None:
    _recorded(tmp_path / "rig.asc", dbc)
    estimates = Machine(_config(dbc), b"").replay(tmp_path / "rig.asc")
    estimates.write(tmp_path / "out")
    summary = estimates.summary
    with (tmp_path / "out" / "estimates.csv").open() as file:
        rows = list(csv.DictReader(file))
    # frames lie 0.25 s beside the ticks, so that each of the 119 ticks between 120 frames has its own
    assert summary["rows"] == len(rows) == 119
    assert all(row["quality_t1"] == "good" and row["innovation_t1_K"] for row in rows)
    assert summary["quality"]["good"] + summary["quality"]["starting"] == 119
    assert summary["quality"]["starting"] == 41  # those of the first 20 s, two a second
    assert float(rows[-1]["field_0_degC"]) > float(rows[-1]["field_600_degC"])


def test_two_formats_of_one_recording_give_the_same_estimates(tmp_path: Path, dbc: Path) -> None:
    for suffix in ("asc", "blf"):
        _recorded(tmp_path / f"rig.{suffix}", dbc)
        Machine(_config(dbc), b"").replay(tmp_path / f"rig.{suffix}").write(tmp_path / suffix)
    tables = [
        list(csv.reader((tmp_path / suffix / "estimates.csv").read_text().splitlines()))
        for suffix in ("asc", "blf")
    ]
    assert len(tables[0]) == len(tables[1])
    for one, other in zip(*(table[1:] for table in tables), strict=True):
        # .asc writes times to a microsecond, .blf to a nanosecond: the estimates differ by that much only
        assert math.isclose(float(one[1]), float(other[1]), rel_tol=1e-4, abs_tol=1e-4)


def test_a_recording_without_a_can_driver_is_one_sentence(tmp_path: Path, dbc: Path) -> None:
    _recorded(tmp_path / "rig.asc", dbc)
    with pytest.raises(ConfigError, match=r"needs a \[drivers"):
        Machine(_config(dbc, with_driver=False), b"").replay(tmp_path / "rig.asc")


def test_a_recording_that_goes_back_in_time_is_rejected(tmp_path: Path, dbc: Path) -> None:
    _recorded(tmp_path / "rig.blf", dbc, backwards=True)
    with pytest.raises(LogError, match="backwards"):
        Machine(_config(dbc), b"").replay(tmp_path / "rig.blf")


def test_a_recording_with_a_cut_last_line_is_replayed_with_a_warning(tmp_path: Path, dbc: Path) -> None:
    _recorded(tmp_path / "rig.log", dbc)
    data = (tmp_path / "rig.log").read_bytes()
    (tmp_path / "rig.log").write_bytes(data[:-5])
    summary = Machine(_config(dbc), b"").replay(tmp_path / "rig.log").summary
    assert summary["rows"] == 118
    assert summary["doubts"][0] == "the last line (120) is cut off and left out"
