"""One signal a row, and files of several rates, become one log with every sample at its own time."""

from __future__ import annotations

import numpy as np
import pytest

from observer.align.log_times import intervals_s
from observer.errors import LogError
from observer.intake.mapped import read_foreign
from tests.intake.machine import configured, read, truth

CHANNELS = ("t1_degC", "t2_degC", "nut_position_m", "screw_speed_rpm", "ambient_degC")


def mtconnect(was) -> str:
    """As an MTConnect agent's samples are kept: when, what, its value; speeds only on change."""
    rows = ["timestamp,dataItemId,name,value"]
    for i, moment in enumerate(was.moments()):
        stamp = f"{moment:%Y-%m-%dT%H:%M:%S}.{moment.microsecond:06d}Z"
        items = [("Zpos", "nut_position_m", was.nut_position_m[i]), ("Temp1", "t1_degC", was.t1_degC[i])]
        items += [("S1", "screw_speed_rpm", was.screw_speed_rpm[i])] if i % 3 == 0 else []
        items += (
            [("Temp2", "t2_degC", was.t2_degC[i]), ("Amb", "ambient_degC", was.ambient_degC[i])]
            if i % 2 == 0
            else []
        )
        rows += [f"{stamp},{item},{name},{value if i != 6 else 'UNAVAILABLE'}" for item, name, value in items]
    return "\n".join(rows) + "\n"


@pytest.mark.parametrize("given", [True, False])
def test_one_signal_a_row(tmp_path, given):
    was, path = truth(), tmp_path / "agent.csv"
    path.write_text(mtconnect(was), encoding="utf-8")
    names = {
        "nut_position_m": "Zpos", "t1_degC": "Temp1", "screw_speed_rpm": "S1", "t2_degC": "Temp2",
        "ambient_degC": "Amb",
    }  # fmt: skip
    columns = "[log.columns]\n" + "".join(f'{k} = "{v}"\n' for k, v in names.items())
    by_name = '\n[log]\nlong = { name = "name", value = "value" }\n'
    log = read(path, by_name if given else "\n" + columns)
    assert log.joined
    np.testing.assert_allclose(log.time_s, was.time_s, atol=1e-5)
    t1_degC, speed = (log.values[:, log.channels.index(name)] for name in ("t1_degC", "screw_speed_rpm"))
    good = np.arange(len(was.time_s)) != 6
    np.testing.assert_allclose(t1_degC[good], was.t1_degC[good])
    assert np.isnan(t1_degC[6])
    np.testing.assert_allclose(speed[[10, 11, 12]], was.screw_speed_rpm[[9, 9, 12]])
    assert any("UNAVAILABLE" in words.text for words in log.words)


def test_one_signal_a_row_is_found_also_where_its_time_has_our_name(tmp_path):
    was, path = truth(), tmp_path / "long.csv"
    rows = ["time_s,signal,value"]
    for i, time_s in enumerate(was.time_s.tolist()):
        rows += [f"{time_s!r},{name},{getattr(was, name)[i]}" for name in CHANNELS]
    path.write_text("\n".join(rows) + "\n", encoding="utf-8")
    log = read(path)
    for name in CHANNELS:
        np.testing.assert_array_equal(log[name], getattr(was, name))


def test_files_of_several_rates_are_joined_on_their_clocks(tmp_path):
    was = truth()
    fast, slow = tmp_path / "axis.csv", tmp_path / "logger.csv"
    rows = zip(was.moments(), was.nut_position_m, was.screw_speed_rpm, strict=True)
    fast.write_text(
        "time,nut_position_m,screw_speed_rpm\n" + "".join(f"{m.isoformat()},{x},{n}\n" for m, x, n in rows)
    )
    some = list(zip(was.moments(), was.t1_degC, was.t2_degC, was.ambient_degC, strict=True))[::4]
    slow.write_text(
        "Zeit;t1 [°C];t2 [°C];ambient [°C]\n"
        + "".join(f"{m:%d.%m.%Y %H:%M:%S};{a};{b};{c}\n".replace(".", ",", 0) for m, a, b, c in some),
        encoding="utf-8",
    )
    config = configured(tmp_path, '\n[log]\ntimezone = "UTC"\n')
    log = read_foreign([fast, slow], config)
    np.testing.assert_allclose(log.time_s, was.time_s, atol=1e-5)
    found_s = intervals_s(log, config.channels, np.full(len(config.channels), np.nan))
    by_name = dict(zip(config.channels, found_s, strict=True))
    assert by_name["t1_degC"] == pytest.approx(6.0, abs=1e-3)
    assert by_name["nut_position_m"] == pytest.approx(1.5, abs=1e-3)
    t1_degC = log.values[:, log.channels.index("t1_degC")]
    np.testing.assert_allclose(t1_degC[::4], was.t1_degC[::4])


def test_files_that_count_from_different_beginnings_are_not_joined(tmp_path):
    was = truth()
    one, other = tmp_path / "one.csv", tmp_path / "other.csv"
    one.write_text(
        "time,nut_position_m,screw_speed_rpm\n"
        + "".join(
            f"{m.isoformat()},0.5,{n}\n" for m, n in zip(was.moments(), was.screw_speed_rpm, strict=True)
        )
    )
    other.write_text(
        "t [s],t1_degC,t2_degC,ambient_degC\n"
        + "".join(f"{1.5 * i},{a},22,21\n" for i, a in enumerate(was.t1_degC))
    )
    with pytest.raises(LogError, match=r"other\.csv counts from its own beginning"):
        read_foreign([one, other], configured(tmp_path))
