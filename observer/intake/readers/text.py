"""Reads text in any layout: finds encoding, separator, decimals, preamble, header and row of units."""

from __future__ import annotations

import codecs
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from observer.config.logs import Logs
from observer.files.log_checks import MOST_LISTED, several
from observer.files.logs import bytes_of
from observer.intake.cells import without_units
from observer.intake.headers import (
    above_the_table,
    another_header,
    headers_left_out,
    repeated_headers,
    rows_of_text,
)
from observer.intake.layout import (
    SAMPLE_LINES,
    TableLayout,
    decimal_of,
    is_value,
    layout_of,
    names_of,
    numeric_columns,
    separator_of,
    split_lines,
)
from observer.intake.readers import klippy, line_protocol, lvm, shdr, twincat
from observer.intake.sheets import RawColumn, Sheet

_BOMS = (
    (codecs.BOM_UTF8, "utf-8-sig"), (codecs.BOM_UTF32_LE, "utf-32"), (codecs.BOM_UTF32_BE, "utf-32"),
    (codecs.BOM_UTF16_LE, "utf-16"), (codecs.BOM_UTF16_BE, "utf-16"),
)  # fmt: skip
_WESTERN = set("°µ²³äöüßÄÖÜéèêàâçñÉ·±Ωøåæœíóúáìòù´€§«»–—’“”…")
_WIDTHS = {"utf-16": 2, "utf-32": 4}
_KINDS: tuple[tuple[Callable[[str], bool], Callable[[Path, str], list[Sheet]]], ...] = (
    (twincat.recognises, twincat.read),
    (klippy.recognises, klippy.read),
    (shdr.recognises, shdr.read),
    (line_protocol.recognises, line_protocol.read),
)
"""Formats that a text shows itself to be in, and their readers."""
_TOA5 = ('"TOA5"', "TOA5,")
MOST_MISFITS = 0.05
"""Fraction of a table's rows that may have another number of cells; they are left out and reported."""
_OTHERS = ["cp1250", "cp1251", "cp932", "gb18030", "cp949", "big5"]


def read_text(path: Path, options: Logs, accept_truncated: bool = False) -> list[Sheet]:
    """Read a text file as one sheet, or as the sheets of a format that the text shows itself to be in.

    Args:
        path: The file, compressed or not.
        options: The `[log]` table; `encoding`, `separator`, `decimal`, `skip_rows` and `units_row` replace
            guesses.
        accept_truncated: Drop a last row that was cut off, instead of refusing the file.

    Raises:
        LogError: The text is not in its encoding, is cut off, or holds no table; all that is wrong at once.
    """
    data, cut = bytes_of(path)
    encoding = options.encoding or encoding_of(data)
    if (code_width := _WIDTHS.get(encoding.replace("_", "-").lower()[:6], 1)) > 1:
        data, cut = (
            data + b"\0" * (-len(data) % code_width),
            False,
        )  # the zeros at its end are of its last sign
    text = decoded(path, data, encoding)
    if text.startswith("LabVIEW Measurement"):
        return lvm.read_lvm(path, text)
    text = text.replace("\r\n", "\n").replace("\r", "\n")
    if accept_truncated and (cut or not text.endswith("\n")):
        text = text[: text.rfind("\n") + 1]
    elif cut:
        remedy = "use the rows before it with --accept-truncated, or copy the log again"
        raise several(path, [f"line {text.count(chr(10)) + 1} is cut off; {remedy}"])
    for recognises, read in _KINDS:
        if recognises(text):
            return read(path, text)
    if text.lstrip().startswith(_TOA5):
        return [sheet_of(path, text, options, header=1)]
    return [sheet_of(path, text, options)]


def decoded(path: Path, data: bytes, encoding: str) -> str:
    """Return the text of a file in an encoding, without a byte order mark.

    Args:
        path: The file, named in errors.
        data: Its bytes.
        encoding: A name that Python knows, such as `cp1252`.

    Raises:
        LogError: The bytes are not text in this encoding.
    """
    try:
        return data.decode(encoding).removeprefix("\ufeff")
    except UnicodeError:
        raise several(path, [f"is not text in {encoding}; give [log] encoding"]) from None


def encoding_of(data: bytes) -> str:
    """Return the likely encoding of bytes of text.

    A byte order mark decides, then zero bytes (UTF-16), then valid UTF-8. The rest is cp1252 if its letters
    are Western, else what charset_normalizer finds.
    """
    for mark, name in _BOMS:
        if data.startswith(mark):
            return name
    sample = data[:65536]
    if (zeros := sample.count(0)) > len(sample) // 4:
        return "utf-16-le" if sample[1::2].count(0) > zeros // 2 else "utf-16-be"
    try:
        data.decode("utf-8")
        return "utf-8"
    except UnicodeDecodeError:
        pass
    strange = {c for c in data.decode("cp1252", "replace") if ord(c) > 127}
    if strange <= _WESTERN:
        return "cp1252"
    from charset_normalizer import from_bytes  # noqa: PLC0415 - only where nothing plainer fits

    best = from_bytes(data[:200_000], cp_isolation=["cp1252", *_OTHERS]).best()
    return "cp1252" if best is None else best.encoding


@dataclass(frozen=True, slots=True)
class _Misfits:
    """Rows whose number of cells differs from the table's: their lines and contents."""

    lines: list[int]
    texts: list[str]


def sheet_of(path: Path, text: str, options: Logs, header: int | None = None) -> Sheet:
    r"""Return the table in a text.

    Rows with another number of cells are left out, up to 5 % of the rows, and reported as doubts.

    Args:
        path: The file, named in errors.
        text: Its text, lines ended by `\n`.
        options: The `[log]` table.
        header: Number of its header row from 0, followed by units and kinds as in TOA5; None to find it.

    Raises:
        LogError: The text holds no table, a second table, an open quote, or too many rows that do not fit.
    """
    lines = text.split("\n", SAMPLE_LINES)[:SAMPLE_LINES]
    separator = options.separator or separator_of(lines)
    rows = split_lines([line.replace("\0", "") for line in lines], separator)
    layout = layout_of(rows, options.skip_rows, options.units_row)
    if header is not None and len(rows) > header + 2:  # TOA5: names, units, kinds of processing
        layout = TableLayout(header, header + 1, header + 3, len(rows[header]))
    if layout.width < 1 or (layout.width < 2 and options.separator is None):
        raise several(path, ["holds no recognisable columns of numbers and times; give [log] separator"])
    names = rows[layout.header] if layout.header >= 0 else []
    units = rows[layout.units] if layout.units >= 0 else []
    decimal = options.decimal or decimal_of(rows[layout.data :])
    table, misfits = _parsed(text, separator, layout.width, layout.data)
    problems, doubts = _problems_and_doubts(
        misfits, layout.width, len(names), layout.data, separator, len(table)
    )
    if problems:
        raise several(path, problems)
    doubts += above_the_table([i + 1 for i in layout.above])
    numeric = numeric_columns(rows[layout.data :], layout.width)
    repeated, other = repeated_headers(rows_of_text(table.columns, numeric), [names, units], numeric)
    numbers = _line_numbers(text, layout.data, misfits.lines, len(table))
    doubts += headers_left_out([int(numbers[i]) for i in repeated])
    if other:
        raise several(path, [another_header(int(numbers[other[0]]))])
    data_rows = np.setdiff1d(np.arange(len(table)), repeated)
    columns = [
        without_units(RawColumn(name, column.combine_chunks().take(data_rows), unit))
        for (name, unit), column in zip(names_of(names, units, layout.width), table.columns, strict=True)
        if not (name.startswith("column ") and column.null_count == len(column))
    ]
    return Sheet(
        path,
        "",
        tuple(columns),
        decimal=decimal,
        first_line=layout.data + 1,
        lines=numbers[data_rows],
        left_out=tuple(misfits.lines),
        doubts=tuple(doubts),
        preamble=tuple(lines[: max(layout.header, 0)]),
    )


def _line_numbers(text: str, data: int, left_out: list[int], rows: int) -> NDArray[np.int64]:
    """Return the line number of each row (n,); blank lines and lines in `left_out` are not rows."""
    consecutive = np.arange(data + 1, data + 1 + rows)
    if "\n\n" not in text.rstrip("\n") and not left_out:
        return consecutive
    excluded = set(left_out)
    filled = [
        i for i, line in enumerate(text.split("\n")[data:], data + 1) if line.strip() and i not in excluded
    ]
    return np.array(filled[:rows], np.int64) if len(filled) >= rows else consecutive


def _parsed(text: str, separator: str, width: int, skip: int) -> tuple[Any, _Misfits]:
    """Return the cells of a text as strings, empty ones null, and the rows with another number of cells."""
    import pyarrow as pa  # noqa: PLC0415 - slow to import, and the daemon reads no log
    from pyarrow import csv as pa_csv  # noqa: PLC0415

    misfits = _Misfits([], [])
    if separator == " ":
        text, separator = "\n".join("\t".join(line.split()) for line in text.split("\n")), "\t"

    def misfit(row: Any) -> str:
        if row.text.strip(f"{separator} \t"):
            misfits.lines.append(row.number or 0)
            misfits.texts.append(row.text)
        return "skip"

    names = [str(i) for i in range(width)]
    table = pa_csv.read_csv(
        pa.py_buffer(text.encode()),
        read_options=pa_csv.ReadOptions(column_names=names, skip_rows=skip, use_threads=False),
        parse_options=pa_csv.ParseOptions(delimiter=separator, invalid_row_handler=misfit),
        convert_options=pa_csv.ConvertOptions(
            column_types=dict.fromkeys(names, pa.string()), strings_can_be_null=True, null_values=[""]
        ),
    )
    return table, misfits


def _problems_and_doubts(
    misfits: _Misfits, width: int, named: int, data: int, separator: str, rows: int
) -> tuple[list[str], list[str]]:
    """Return errors and doubts about rows with another number of cells.

    A few such rows, and text below the table, are only doubts.
    """
    if named and width > named and separator == ",":
        return [
            f"line {data + 1} has {width} cells where the header names {named}, which looks like decimal "
            "commas in columns separated by commas; export it with semicolons, or with points"
        ], []
    problems: list[str] = []
    doubts: list[str] = []
    for line, text in zip(misfits.lines, misfits.texts, strict=True):
        if below := text.rstrip("\n").count("\n"):
            return [f"line {line} opens a quote that is not closed for {below} lines; remove it"], []
        cells = split_lines([text], separator)[0]
        if any(map(is_value, cells)) and len(cells) > 1:
            if below := text.strip().count("\n"):
                return [
                    f"line {line} opens a quotation that takes in {below} lines below it; "
                    "remove its odd quotation mark"
                ], doubts
            extra = ", as decimal commas make them" if separator == "," and len(cells) > width else ""
            problems.append(f"line {line} has {len(cells)} cells where the table has {width}{extra}")
        else:
            doubts.append(f"line {line} is not a row of the table and was left out: {text[:40]!r}")
    if len(doubts) > MOST_LISTED:
        doubts = [*doubts[:2], f"{len(doubts) - 2} more lines are not rows of the table and were left out"]
    if len(problems) > max(1, MOST_MISFITS * rows):
        return [f"{problem}; fix or remove it" for problem in problems], doubts
    total = f" ({len(problems)} such rows)" if len(problems) > 1 else ""
    left_out = [f"{problem}, and was left out{total}" for problem in problems[:MOST_LISTED]]
    if len(problems) > MOST_LISTED:
        left_out.append(
            f"{len(problems) - MOST_LISTED} more rows have another number of cells and were left out"
        )
    return [], left_out + doubts
