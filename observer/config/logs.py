"""The `[log]` table: how to read logs that others wrote, and how often their rows and sensors come."""

from __future__ import annotations

import codecs
import zoneinfo
from typing import Annotated, Literal

from pydantic import Field, field_validator, model_validator

from observer.config import quantities
from observer.config.quantities import Section

Text = Annotated[str, Field(min_length=1, max_length=256)]
TIME_UNITS = ("s", "ms", "us", "ns", "min", "h", "d", "excel", "labview", "filetime")
"""What a number in a time column may count: `excel` days since 1899-12-30 on a wall clock, `labview` seconds
since 1904, `filetime` tenths of a microsecond since 1601."""


class LogColumn(Section):
    """Where a channel's values are."""

    column: Text  #: its column; `"group/name"` with several groups or sheets
    #: its unit, as `"degF"`, `"mm"`, `"1/s"`; – is that of the file, else of the channel
    unit: Text | None = None


class LongForm(Section):
    """The columns of a file that has one signal in a row."""

    #: column that names the signal
    name: Text
    #: column of its value
    value: Text


class Logs(Section):
    """How to read logs that others wrote. Keys that are left out are detected where the file leaves no
    doubt.
    """

    #: separator of columns: `";"`, `","`, `"\t"`, `" "`
    separator: Annotated[str, Field(min_length=1, max_length=1)] | None = None
    decimal: Literal[".", ","] | None = None  #: decimal separator: `"."` or `","`
    #: of a text file, as `"cp1252"`
    encoding: Text | None = None
    #: lines above the header
    skip_rows: Annotated[quantities.Count, Field(ge=0, le=100_000)] | None = None
    #: whether the row below the header holds units
    units_row: quantities.Flag | None = None
    #: column of the time, or the two of date and time
    time: Text | Annotated[tuple[Text, ...], Field(min_length=1, max_length=2)] | None = None
    #: how the time is written: `"%d.%m.%Y %H:%M:%S"` and the like, or what a number counts: `"s"`, `"ms"`,
    #: `"us"`, `"ns"`, `"min"`, `"h"`, `"d"`, `"excel"`, `"labview"` (seconds since 1904), `"filetime"`
    time_format: Text | None = None
    #: interval of the rows of a log without a clock: `60.0`
    every_s: Annotated[quantities.Positive, Field(le=86_400.0)] | None = None
    #: further words and numbers for a missing value: `["OVLD", "-9.9E+37"]`
    missing: tuple[Text, ...] = Field(default=(), max_length=64)
    #: of times that name no zone, as `"Europe/Berlin"`
    timezone: Text | None = None
    #: whether inputs keep their value until the next row (`true`), or ramp to it
    hold: quantities.Flag = False
    #: a [log](log.md#a-log) with rows mostly further apart is rejected: its times look like milliseconds
    rows_apart_s: quantities.Positive = 600.0
    #: interval of sensors that are slower than the rows: `4.0`, or `{ t1 = 4.0, t2 = 20.0 }`; – is learnt
    #: from the log
    sensor_period_s: quantities.Duration | dict[quantities.Name, quantities.Duration] | None = None
    #: where each row holds one signal: `{ name = "dataItemId", value = "value" }`
    long: LongForm | None = None
    #: columns of channels under other names: `t1_degC = { column = "Temp1 [F]", unit = "degF" }`, or the name
    #: alone
    columns: dict[quantities.Channel, LogColumn] = Field(default_factory=dict, max_length=256)

    @field_validator("columns", mode="before")
    @classmethod
    def _names_alone(cls, entry: object) -> object:
        if not isinstance(entry, dict):
            return entry
        return {k: {"column": v} if isinstance(v, str) else v for k, v in entry.items()}

    @field_validator("encoding")
    @classmethod
    def _known_encoding(cls, name: str | None) -> str | None:
        try:
            codecs.lookup(name or "utf-8")
        except LookupError:
            raise ValueError(f'{name!r} is no encoding; give one such as "cp1252" or "utf-16"') from None
        return name

    @model_validator(mode="after")
    def _one_clock(self) -> Logs:
        if self.every_s is not None and (self.time is not None or self.time_format is not None):
            raise ValueError("every_s is for a log without a clock; remove it, or time and time_format")
        return self

    @field_validator("timezone")
    @classmethod
    def _known_zone(cls, name: str | None) -> str | None:
        try:
            zoneinfo.ZoneInfo(name or "UTC")
        except (ValueError, OSError, zoneinfo.ZoneInfoNotFoundError):
            raise ValueError(f'{name!r} is no time zone; give one such as "Europe/Berlin" or "UTC"') from None
        return name

    @field_validator("time_format")
    @classmethod
    def _known_format(cls, text: str | None) -> str | None:
        if text is not None and text not in TIME_UNITS and "%" not in text:
            raise ValueError(
                f'{text!r} is no format of times; give one such as "%d.%m.%Y %H:%M:%S", or one of '
                f"{', '.join(TIME_UNITS)}"
            )
        return text
