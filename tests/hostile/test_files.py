"""Logs and DBC files with damaged bytes are read, or refused in one sentence."""

from __future__ import annotations

import gzip
import os
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest
from pyarrow import parquet

from drivers.can import CanSettings
from drivers.dbc import dbc_problems, load_decoder
from observer.errors import LogError, UserError
from observer.files.logs import Log, read_log
from tests.hostile.bits import damaged
from tests.hostile.test_wires import MUX_DBC
from tests.system.bad_inputs import CHANNELS, rows, text
from tests.system.plant import ROOT

AXIS = ROOT / "drivers" / "simulated" / "axis.dbc"
MOST = 150


def _parquet(folder: Path) -> bytes:
    columns = list(zip(*rows()[1:], strict=True))
    table = pa.table({n: np.array(c, dtype=np.float64) for n, c in zip(rows()[0], columns, strict=True)})
    parquet.write_table(table, folder / "good.parquet")
    return (folder / "good.parquet").read_bytes()


def _recording() -> bytes:
    body = [[*row, "1", "t1_degC=open_circuit"] for row in rows()[1:]]
    return text([[*rows()[0], "step", "flags"], *body]).encode()


LOGS = {
    "log.csv": lambda _: text(rows()).encode(),
    "recording.csv": lambda _: _recording(),
    "log.csv.gz": lambda _: gzip.compress(text(rows()).encode(), mtime=0),
    "log.parquet": _parquet,
}


def assert_one_sentence(error: UserError) -> None:
    """One sentence, or a list of at most ten of them and how many more there are."""
    first, *listed = str(error).split("\n")
    assert all(said.isprintable() for said in (first, *listed)), (first, listed)
    assert len(listed) != 1
    assert len(listed) <= 11
    assert len(str(error)) < 1500 + 200 * len(listed), str(error)


def _assert_sound(log: Log) -> None:
    assert np.isfinite(log.time_s).all()
    assert (np.diff(log.time_s) > 0).all()
    assert log.values.shape == (len(log.time_s), len(log.channels))


@pytest.mark.parametrize("name", LOGS)
def test_a_damaged_log_is_read_or_rejected(name, tmp_path):
    good, path = LOGS[name](tmp_path), tmp_path / name
    path.write_bytes(good)
    _assert_sound(read_log(path, CHANNELS))
    refused = 0
    for label, data in damaged(good, MOST, seed=len(name)):
        path.write_bytes(data)
        try:
            _assert_sound(read_log(path, CHANNELS))
        except LogError as error:
            assert_one_sentence(error)
            refused += 1
        except BaseException as error:
            error.add_note(label)
            raise
    assert refused > MOST // 4


def _pipe(folder: Path) -> Path:
    os.mkfifo(folder / "log.csv")
    return folder / "log.csv"


def _endless(folder: Path) -> Path:
    (folder / "log.csv").symlink_to("/dev/zero")
    return folder / "log.csv"


@pytest.mark.parametrize("made", [_pipe, _endless])
def test_a_log_that_is_not_a_file_is_rejected(made, tmp_path):
    with pytest.raises(LogError, match="cannot be read"):
        read_log(made(tmp_path), CHANNELS)


@pytest.mark.parametrize("content", [AXIS.read_bytes(), MUX_DBC.encode()], ids=["axis", "mux"])
def test_a_damaged_dbc_is_used_or_rejected(content, tmp_path):
    path = tmp_path / "damaged.dbc"
    names = ("AxisStatus", "NutPosition") if b"AxisStatus" in content else ("Mux", "One")
    settings = CanSettings.model_validate(
        {
            "kind": "can", "interface": "virtual", "channel": "x", "dbc": path,
            "channels": {"x_m": {"message": names[0], "signal": names[1]}},
        }
    )  # fmt: skip
    path.write_bytes(content)
    assert dbc_problems(settings.signals("axis")) == []
    refused = 0
    for label, data in damaged(content, MOST, seed=5):
        path.write_bytes(data)
        try:
            load_decoder(settings.signals("axis"))
        except UserError as error:
            assert_one_sentence(error)
            refused += 1
        except BaseException as error:
            error.add_note(label)
            raise
    assert refused > MOST // 4


@pytest.mark.parametrize(
    "line",
    [
        'BO_ 1 M: 4000000000 A\n SG_ S : 0|8@1+ (1,0) [0|0] "" A\n',
        'BO_ 1 M: 8 A\n SG_ S : 4000000000|8@1+ (1,0) [0|0] "" A\n',
        'BO_ 1 M: 8 A\n SG_ S : 0|4000000000@1+ (1,0) [0|0] "" A\n',
    ],
)
def test_a_message_of_gigabytes_is_rejected(line, tmp_path):
    path = tmp_path / "large.dbc"
    path.write_text('VERSION ""\n\nBU_: A\n\n' + line)
    settings = CanSettings.model_validate(
        {
            "kind": "can", "interface": "virtual", "channel": "x", "dbc": path,
            "channels": {"x_m": {"message": "M", "signal": "S"}},
        }
    )  # fmt: skip
    (problem,) = dbc_problems(settings.signals("axis"))
    assert "large.dbc" in problem
