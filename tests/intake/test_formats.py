"""Files of other programs' own formats, written by their libraries, become the log that they hold."""

from __future__ import annotations

import zipfile
from collections.abc import Callable
from datetime import timedelta
from pathlib import Path

import can
import numpy as np
import openpyxl
import pyarrow as pa
import pytest
from asammdf import MDF, Signal
from nptdms import ChannelObject, TdmsWriter
from pyarrow import feather, parquet

from observer.intake.readers import holds_signals
from observer.process.memory import import_mf4
from tests.intake.machine import START, Truth, assert_is, read, truth

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


@pytest.mark.parametrize(
    ("suffix", "write"),
    [
        (".xlsx", workbook),
        (".ods", of_libreoffice),
        (".parquet", of_parquet),
        (".parquet", of_pandas),
        (".feather", of_feather),
        (".mf4", measurement("4.10")),
        (".mdf", measurement("3.30")),
        (".dat", measurement("3.30")),
        (".tdms", waveforms),
        (".tdms", stamped),
        (".lvm", labview),
    ],
)
def test_what_other_programs_write_is_read_as_it_is(tmp_path, suffix, write):
    was, path = truth(), tmp_path / f"run{suffix}"
    write(path, was)
    zone = '\n[log]\ntimezone = "UTC"' if write in (workbook, of_libreoffice, labview) else ""
    assert_is(read(path, zone), was, apart=1e-6)


def test_signals_of_mdf_are_distinguished_from_bus_frames(tmp_path):
    measurement("4.10")(tmp_path / "signals.mf4", truth())
    import_mf4()
    with can.MF4Writer(tmp_path / "bus.mf4") as writer:
        writer.on_message_received(
            can.Message(timestamp=1.0, arbitration_id=0x12, data=[1, 2], is_extended_id=False)
        )
    assert holds_signals(tmp_path / "signals.mf4")
    assert not holds_signals(tmp_path / "bus.mf4")


@pytest.mark.parametrize(
    ("suffix", "write"), [(".xlsx", workbook), (".mf4", measurement("4.10")), (".tdms", waveforms)]
)
def test_a_damaged_file_ends_in_one_sentence(tmp_path, suffix, write):
    from observer.errors import LogError

    write(tmp_path / f"whole{suffix}", truth())
    path = tmp_path / f"cut{suffix}"
    path.write_bytes((tmp_path / f"whole{suffix}").read_bytes()[:700])
    with pytest.raises(LogError, match="cut") as caught:
        read(path)
    assert "\n" not in str(caught.value)


def test_sheets_of_one_workbook_have_their_own_rates(tmp_path):
    was = truth()
    book = openpyxl.Workbook()
    fast, slow = book.active, book.create_sheet("Temperaturen")
    fast.title = "Achse"
    fast.append(["Time", *NAMES[2:4]])
    slow.append(["Time", *NAMES[:2], NAMES[4]])
    for i, (moment, *cells) in enumerate(zip(was.moments(), *columns(was), strict=True)):
        local = (moment + timedelta(hours=1)).replace(tzinfo=None)
        fast.append([local, *map(float, cells[2:4])])
        if i % 4 == 0:
            slow.append([local, *map(float, (*cells[:2], cells[4]))])
    book.save(tmp_path / "run.xlsx")
    log = read(tmp_path / "run.xlsx", '\n[log]\ntimezone = "Europe/Berlin"')
    assert log.joined
    np.testing.assert_allclose(log.time_s, was.time_s, atol=1e-4)
    t1_degC = log.values[:, log.channels.index("t1_degC")]
    np.testing.assert_allclose(t1_degC[::4], was.t1_degC[::4])
    assert np.isnan(t1_degC[1::4]).all()
    assert np.isfinite(log.values[:, log.channels.index("nut_position_m")]).all()
