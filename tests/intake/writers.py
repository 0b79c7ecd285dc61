"""Logs as other programs write them: `writer(path, truth)` for each kind of file."""

from __future__ import annotations

import zipfile
from collections.abc import Callable
from datetime import timedelta
from pathlib import Path

import numpy as np
import openpyxl
import pyarrow as pa
from asammdf import MDF, Signal
from nptdms import ChannelObject, TdmsWriter
from pyarrow import feather, parquet

from tests.intake.machine import START, Truth

NAMES = ("t1 [degC]", "t2 [degC]", "nut position [mm]", "screw speed [rpm]", "ambient [degC]")


def columns(was: Truth) -> list[np.ndarray]:
    return [was.t1_degC, was.t2_degC, 1000.0 * was.nut_position_m, was.screw_speed_rpm, was.ambient_degC]


def workbook(path: Path, was: Truth) -> None:
    book = openpyxl.Workbook()
    about = book.active
    about.title = "Info"
    about.append(["Warm-up of axis Z"])
    sheet = book.create_sheet("Messung")
    sheet.append(["exported by hand"])
    sheet.append([])
    sheet.append(["Time", *NAMES])
    for moment, *cells in zip(was.moments(), *columns(was), strict=True):
        sheet.append([moment.replace(tzinfo=None), *map(float, cells)])
    book.save(path)


def of_libreoffice(path: Path, was: Truth) -> None:
    """As LibreOffice Calc saves a sheet; OpenDocument 1.3 part 3, 9.1 and 19.385."""
    words = "".join(
        f'<table:table-cell office:value-type="string"><text:p>{name}</text:p></table:table-cell>'
        for name in ("Time", *NAMES)
    )
    rows = [f"<table:table-row>{words}</table:table-row>"]
    for moment, *cells in zip(was.moments(), *columns(was), strict=True):
        when = moment.replace(tzinfo=None).isoformat(timespec="milliseconds")
        date = f'<table:table-cell office:value-type="date" office:date-value="{when}"/>'
        numbers = "".join(
            f'<table:table-cell office:value-type="float" office:value="{float(cell)!r}"/>' for cell in cells
        )
        rows.append(f"<table:table-row>{date}{numbers}</table:table-row>")
    spaces = " ".join(
        f'xmlns:{short}="urn:oasis:names:tc:opendocument:xmlns:{name}:1.0"'
        for short, name in (("office", "office"), ("table", "table"), ("text", "text"))
    )
    kind = "application/vnd.oasis.opendocument.spreadsheet"
    with zipfile.ZipFile(path, "w") as ods:
        ods.writestr("mimetype", kind)
        ods.writestr(
            "META-INF/manifest.xml",
            '<manifest:manifest xmlns:manifest="urn:oasis:names:tc:opendocument:xmlns:manifest:1.0">'
            f'<manifest:file-entry manifest:full-path="/" manifest:media-type="{kind}"/></manifest:manifest>',
        )
        ods.writestr(
            "content.xml",
            f'<office:document-content {spaces} office:version="1.3"><office:body><office:spreadsheet>'
            f'<table:table table:name="Messung">{"".join(rows)}</table:table>'
            "</office:spreadsheet></office:body></office:document-content>",
        )


def arrow(was: Truth) -> pa.Table:
    moments = pa.array(was.moments(), pa.timestamp("ms", "Europe/Berlin"))
    return pa.table([moments, *columns(was)], names=["when", *NAMES])


def of_parquet(path: Path, was: Truth) -> None:
    parquet.write_table(arrow(was), path)


def of_feather(path: Path, was: Truth) -> None:
    feather.write_feather(arrow(was), str(path))


def of_pandas(path: Path, was: Truth) -> None:
    """As pandas writes a frame whose index are times."""
    import pandas as pd

    frame = pd.DataFrame(dict(zip(NAMES, columns(was), strict=True)), index=pd.DatetimeIndex(was.moments()))
    frame.to_parquet(path)


def measurement(version: str) -> Callable[[Path, Truth], None]:
    def write(path: Path, was: Truth) -> None:
        since_s = was.time_s - was.time_s[0]
        mdf = MDF(version=version)
        mdf.header.start_time = START
        signals = [
            Signal(values, since_s, unit=name[name.index("[") + 1 : -1], name=name[: name.index("[")].strip())
            for name, values in zip(NAMES, columns(was), strict=True)
        ]
        mdf.append(signals[:2])
        mdf.append(signals[2:])
        mdf.save(path.with_suffix(".mdf" if version < "4" else ".mf4"), overwrite=True)
        mdf.close()
        if path.suffix == ".dat":  # as INCA names it
            path.with_suffix(".mdf").rename(path)

    return write


def waveforms(path: Path, was: Truth) -> None:
    """As LabVIEW logs waveforms: the clock in each channel's properties."""
    clock = {"wf_start_time": np.datetime64(START.replace(tzinfo=None)), "wf_increment": 1.5}
    with TdmsWriter(str(path)) as file:
        for name, values in zip(NAMES, columns(was), strict=True):
            plain, unit = name.rstrip("]").split(" [")
            file.write_segment([ChannelObject("run", plain, values, clock | {"unit_string": unit})])


def stamped(path: Path, was: Truth) -> None:
    """A group with a channel of times beside the others."""
    moments = np.array([m.replace(tzinfo=None) for m in was.moments()], "datetime64[us]")
    with TdmsWriter(str(path)) as file:
        file.write_segment([ChannelObject("run", "Time", moments)])
        file.write_segment([ChannelObject("run", n, v) for n, v in zip(NAMES, columns(was), strict=True)])


def labview(path: Path, was: Truth) -> None:
    """A LabVIEW measurement as its Write To Measurement File makes it."""
    head = [
        "LabVIEW Measurement\t", "Writer_Version\t2", "Reader_Version\t2", "Separator\tTab",
        "Decimal_Separator\t,", "Multi_Headings\tNo",
        "X_Columns\tOne", "Time_Pref\tRelative", "Operator\tlab", "Date\t2026/11/25",
        "Time\t08:00:00,000", "***End_of_Header***\t", "", "Channels\t5", f"Samples\t{len(was.time_s)}",
        "Date" + "\t2026/11/25" * 5, "Time" + "\t08:00:00,000" * 5,
        "Y_Unit_Label\t" + "\t".join(n[n.index("[") + 1 : -1] for n in NAMES),
        "X_Dimension" + "\tTime" * 5, "X0" + "\t0,0" * 5, "Delta_X" + "\t1,5" * 5,
        "***End_of_Header***" + "\t" * 5,
        "X_Value\t" + "\t".join(n[: n.index("[")].strip() for n in NAMES) + "\tComment",
    ]  # fmt: skip
    rows = [
        "\t".join(f"{cell:.6f}".replace(".", ",") for cell in (s - was.time_s[0], *cells))
        for s, *cells in zip(was.time_s, *columns(was), strict=True)
    ]
    path.write_text("\r\n".join([*head, *rows]) + "\r\n", encoding="cp1252")


GERMAN = """
[log]
timezone = "Europe/Berlin"
[log.columns]
t1_degC = "Temp. Lager"
t2_degC = "Temp. Mutter"
nut_position_m = "X"
screw_speed_rpm = "Drehzahl"
ambient_degC = "Halle"
"""


def german(was: Truth, preamble: str = "") -> str:
    """As a German control writes it: date and time in two columns, decimal commas, mm and 1/min."""
    lines = [preamble + "Datum;Uhrzeit;Temp. Lager [°C];Temp. Mutter [°C];X (mm);Drehzahl [1/min];Halle [°C]"]
    for i, moment in enumerate(was.moments()):
        cells = (was.t1_degC[i], was.t2_degC[i], 1000.0 * was.nut_position_m[i], was.screw_speed_rpm[i])
        numbers = [f"{cell:.2f}".replace(".", ",") for cell in (*cells, was.ambient_degC[i])]
        local = moment + timedelta(hours=1)
        lines.append(
            ";".join([f"{local:%d.%m.%Y}", f"{local:%H:%M:%S},{local.microsecond // 100000}", *numbers])
        )
    return "\r\n".join(lines) + "\r\n"


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


def quoted_text(path: Path, was: Truth) -> None:
    """A table as a German logger writes it, some cells quoted."""
    rows = zip(was.moments(), was.t1_degC, was.t2_degC, was.nut_position_m, strict=True)
    lines = ["Zeit;t1 [degC];t2 [degC];nut position [mm]"]
    lines += [f'"{m:%d.%m.%Y %H:%M:%S.%f}";{a:.2f};"{b:.2f}";{1e3 * x:.2f}' for m, a, b, x in rows]
    path.write_text("\n".join(lines) + "\n", encoding="cp1252")


def recorder(path: Path, was: Truth) -> None:
    """As Graphtec's and Yokogawa's recorders export: much above the table, names, units, a number a row."""
    lines = ["Vendor,GRAPHTEC Corporation", "Model,GL840", "Sampling interval,1.5s", '"Amp settings"']
    lines += ["CH,Signal name,Input,Range", "CH1,t1,TEMP,TC_K", "CH2,t2,TEMP,TC_K", "", "Data"]
    lines += ["Number,Date&Time,ms,t1,t2,nut_position,screw_speed,ambient"]
    lines += ["NO.,Time,ms,degC,degC,mm,rpm,degC"]
    for i, (m, a, b, x, n, c) in enumerate(zip(was.moments(), *columns(was), strict=True)):
        stamp = f"{m:%Y/%m/%d %H:%M:%S},{m.microsecond // 1000}"
        lines.append(f"{i + 1},{stamp},+{a:.2f},+{b:.2f},{x:.1f},{n:.0f},{c:.2f}")
    path.write_text("\n".join(lines) + "\n", encoding="ascii")
