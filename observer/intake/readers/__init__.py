"""One reader per format; each returns the sheets of a file.

Readers convert nothing: cells stay numbers, moments or text. Each format's package is imported by its reader
only, since it is an extra.
"""

from __future__ import annotations

import gzip
import zlib
from pathlib import Path

from observer.config.logs import Logs
from observer.errors import LogError, UserError
from observer.files.regular import one_line, refuse_irregular, refuse_large
from observer.intake.sheets import Sheet

_HEAD = 4096
WORKBOOKS = (".xlsx", ".xlsm", ".xls", ".ods")
ARROW = (".parquet", ".arrow", ".feather", ".ipc")
MEASUREMENTS = (".mf4", ".mdf", ".dat")
TEXTS = (".csv", ".txt", ".tsv", ".dat", ".lvm", ".log", ".shdr", ".lp", ".prn")
SUFFIXES = (*TEXTS, *WORKBOOKS, *ARROW, ".mf4", ".mdf", ".tdms")


def holds_signals(path: Path) -> bool:
    """Return whether a path names an MDF file of signals, and not of the frames of a bus.

    Raises:
        LogError: The file begins as MDF and is damaged.
    """
    if kind_of(path) not in MEASUREMENTS or not path.is_file() or not _begins(path, b"MDF "):
        return False
    from observer.intake.readers.mdf import has_signals  # noqa: PLC0415 - each format has its own package

    return has_signals(path)


def is_text_log(path: Path) -> bool:
    """Return whether a `.log` holds a table or statistics, and not the frames of a bus, as `(time) can0
    …`.

    A file that cannot be opened is not one.
    """
    if kind_of(path) != ".log":
        return False
    try:
        with gzip.open(path) if path.suffix == ".gz" else open(path, "rb") as file:
            lines = [line.strip() for line in file.read(_HEAD).splitlines() if line.strip()]
    except (OSError, EOFError, zlib.error):
        return False
    return bool(lines) and not lines[0].startswith((b"(", b"date "))


def kind_of(path: Path) -> str:
    """Return the suffix of a file without that of its compression, in lower case: `.csv` of `A.CSV.gz`."""
    name = path.name.lower().removesuffix(".gz")
    return Path(name).suffix


def read_sheets(path: Path, options: Logs, accept_truncated: bool = False) -> list[Sheet]:
    """Read every table of a file.

    Args:
        path: The file; its suffix and its first bytes choose the reader.
        options: The `[log]` table, which concerns text and workbooks.
        accept_truncated: Drop a last row that was cut off, instead of refusing the file.

    Returns:
        At least one sheet, each with at least one row.

    Raises:
        LogError: The format is unknown, or the file is missing, unreadable, too large, damaged or without
            values.
        ModuleNotFoundError: The format's package is not installed.
    """
    kind = kind_of(path)
    if kind not in SUFFIXES:
        raise LogError(f"{path}: unknown kind of log; give one of {', '.join(SUFFIXES)}")
    try:
        refuse_irregular(path, "a readable log")
        refuse_large(path, path.stat().st_size)
        if kind == ".log" and not is_text_log(path):
            raise LogError(f"{path}: is a recording of a CAN bus; give it to a command with --config")
        sheets = _read(path, kind, options, accept_truncated)
    except (UserError, ModuleNotFoundError):
        raise
    except FileNotFoundError:
        raise LogError(f"{path}: no such file; give the path of a log") from None
    except OSError as error:
        reason = error.strerror or one_line(str(error))
        raise LogError(f"{path}: cannot be read ({reason}); give a readable log") from None
    except Exception as error:  # noqa: BLE001 - whatever a format's package stumbles over in damaged bytes
        reason = one_line(str(error)) or type(error).__name__
        raise LogError(f"{path}: damaged or not {kind[1:]} ({reason}); copy or export it again") from None
    sheets = [sheet for sheet in sheets if sheet.columns and len(sheet.columns[0])]
    if not sheets:
        raise LogError(f"{path}: holds no table of values; give a log with at least one sample")
    return sheets


def _read(path: Path, kind: str, options: Logs, accept_truncated: bool) -> list[Sheet]:
    """Return the sheets of a file by the reader of its format."""
    if kind in MEASUREMENTS and _begins(path, b"MDF "):
        from observer.intake.readers.mdf import read_mdf  # noqa: PLC0415 - each format has its own package

        return read_mdf(path)
    if kind in WORKBOOKS:
        from observer.intake.readers.workbook import read_workbook  # noqa: PLC0415

        return read_workbook(path, options)
    if kind in ARROW:
        from observer.intake.readers.arrow import read_arrow  # noqa: PLC0415

        return read_arrow(path, kind)
    if kind == ".tdms":
        from observer.intake.readers.tdms import read_tdms  # noqa: PLC0415

        return read_tdms(path)
    from observer.intake.readers.text import read_text  # noqa: PLC0415

    return read_text(path, options, accept_truncated)


def _begins(path: Path, mark: bytes) -> bool:
    with open(path, "rb") as file:
        return file.read(len(mark)) == mark
