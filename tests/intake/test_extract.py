"""`observer import --extract` writes what support needs of a file, in less than 20 kB, of any file."""

from __future__ import annotations

import gzip
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import observer
from observer.errors import LogError
from tests.intake.machine import truth
from tests.intake.writers import of_parquet, workbook

CASES = Path(__file__).parents[1] / "data" / "log-cases"


def extract(folder: Path, *paths: Path) -> str:
    out = folder / "extract.txt"
    assert observer.extract_log(paths, out) == out.stat().st_size < 20_000
    return out.read_text(encoding="utf-8")


@pytest.mark.parametrize("path", sorted(CASES.glob("*/*")), ids=lambda path: path.name)
def test_every_file_that_recorders_write_has_an_extract(tmp_path, path):
    text = extract(tmp_path, path)
    assert path.name in text
    assert str(CASES) not in text
    assert "read as: " in text


def test_an_extract_shows_header_first_and_last_rows_and_what_was_understood(tmp_path):
    text = extract(tmp_path, CASES / "one-short-row" / "short-row.csv")
    for words in (
        "time;t1_degC;t2_degC;t3_degC", "2026-03-02 08:00:00;21.00;22.00;23.00", "line 21 has 3 cells",
        "49 rows", "1772438400.000000", "column 't1_degC'",
    ):  # fmt: skip
        assert words in text


@pytest.mark.parametrize("write", [workbook, of_parquet])
def test_a_binary_file_that_is_read_shows_its_columns_and_first_bytes(tmp_path, write):
    path = tmp_path / ("run.xlsx" if write is workbook else "run.parquet")
    write(path, truth())
    text = extract(tmp_path, path)
    assert "t1 [degC]" in text
    assert "first bytes: b'P" in text


@pytest.mark.parametrize("name", ["noise.csv", "noise.xlsx", "noise.mf4", "noise.tdms", "noise.bin", "noise"])
def test_a_file_that_cannot_be_read_shows_why_and_its_first_bytes_escaped(tmp_path, name):
    path = tmp_path / name
    path.write_bytes(b"\x00\x1b[31m\x07" + np.random.default_rng(5).bytes(300_000))
    text = extract(tmp_path, path)
    assert "\x1b" not in text
    assert "\\x00\\x1b[31m" in text


@pytest.mark.parametrize("encoding", ["utf-16", "utf-8", "cp1252"])
def test_a_long_text_is_shortened_to_its_ends(tmp_path, encoding):
    path = tmp_path / "lang.csv"
    names = ";".join(f"Gehäuse {i} [°C]" for i in range(300))
    rows = "\n".join(f"{i};" + ";".join(["21,5"] * 299) for i in range(500))
    path.write_bytes(f"{names}\n{rows}\nlast line of all\n".encode(encoding))
    text = extract(tmp_path, path)
    assert "Gehäuse 1 [°C]" in text
    assert "last line of all" in text


def test_compressed_text_is_shown_as_text_and_several_files_share_the_size(tmp_path):
    path = tmp_path / "log.csv.gz"
    path.write_bytes(gzip.compress(b"time_s,t1_degC\n" + b"".join(b"%d,21.5\n" % i for i in range(90_000))))
    text = extract(tmp_path, path, CASES / "toa5" / "rig.dat")
    assert "time_s,t1_degC" in text
    assert "TIMESTAMP" in text


def test_a_file_that_does_not_exist_is_named(tmp_path):
    with pytest.raises(LogError, match=r"missing\.csv: cannot be read"):
        observer.extract_log(tmp_path / "missing.csv", tmp_path / "extract.txt")


@pytest.mark.system
def test_the_command_needs_no_configuration_for_an_extract(tmp_path):
    command = [sys.executable, "-m", "observer", "import", str(CASES / "toa5" / "rig.dat")]
    alone = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=100)
    assert alone.returncode == 2
    assert "--extract" in alone.stderr
    done = subprocess.run(
        [*command, "--extract", "out.txt"], cwd=tmp_path, capture_output=True, text=True, timeout=100
    )
    assert done.returncode == 0, done.stderr
    assert "TOA5" in (tmp_path / "out.txt").read_text()
