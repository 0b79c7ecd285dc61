"""Converts files in long form, one signal per row, to a column for each signal."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from observer.intake.sheets import RawColumn, Sheet
from observer.tables.logs import LongForm

_NAME = re.compile(
    r"^(?:data ?item ?id|data ?item|name|signal|channel|kanal|tag|tagname|variable|metric|sensor|item|id|"
    r"messstelle|point|parameter)$",
    re.I,
)
_VALUE = re.compile(r"^(?:value|wert|messwert|result|reading|val|data|y|vvalue|numericvalue)$", re.I)
_UNITS = ("unit", "units", "einheit")
_MOST_SIGNALS = 500


def long_form_of(sheet: Sheet) -> LongForm | None:
    """The columns of name and value of a sheet in long form; None for any other."""
    names = [c for c in sheet.columns if c.is_text and _NAME.match(c.name.strip().replace("_", ""))]
    values = [c for c in sheet.columns if _VALUE.match(c.name.strip().replace("_", ""))]
    for column in names:
        different = len(column.values.unique())
        if values and different <= min(_MOST_SIGNALS, max(len(column) // 2, 1)):
            return LongForm(name=column.name, value=values[0].name)
    return None


def widened(sheet: Sheet, form: LongForm) -> list[tuple[Sheet, NDArray[np.int64]]]:
    """A sheet of one column for each signal, and the rows (k,) of the file's that are its own."""
    name, value = sheet.named(form.name), sheet.named(form.value)
    if name is None or value is None or not name.is_text:
        return []
    encoded = name.values.dictionary_encode()
    codes = np.asarray(encoded.indices.fill_null(-1).to_numpy(zero_copy_only=False))
    unit = next((c for c in sheet.columns if c.is_text and c.name.strip().lower() in _UNITS), None)
    found = []
    for code, signal in enumerate(encoded.dictionary.to_pylist()):
        rows = np.flatnonzero(codes == code)
        said = "" if unit is None else str(unit.values[int(rows[0])].as_py() or "")
        cells = value.values.take(rows) if value.is_text else value.values[rows]
        lines = sheet.lines[rows] if sheet.lines is not None else (sheet.first_line or 1) + rows
        column = RawColumn(str(signal).strip(), cells, said)
        found.append((replace(sheet, columns=(column,), lines=lines), rows))
    return found
