"""Dates in words and in forms that no pattern of ours has, by dateutil: `2. März 2026 8:00`."""

from __future__ import annotations

import datetime
import re
from functools import cache
from typing import Any, ClassVar

from observer.intake.zones import offset_ns

_FEWEST_NUMBERS, _LONGEST = 4, 64
"""Numbers in a text with a date and a time, the month in letters, and its length."""


def moment_of(text: str) -> float | None:
    """Return the date and time in a text, in s since 1970 as if in UTC; None if it is not a date.

    Of two numbers that may both be the day, the first is.
    """
    moment = parsed(text, day_first=True)
    return None if moment is None else ns_of(moment) / 1e9


def ns_of(moment: datetime.datetime) -> int:
    """Return a moment in ns since 1970; one without a zone as if it were in UTC.

    Integers keep the microseconds, which a float of seconds since 1970 would round.
    """
    utc = moment if moment.tzinfo is not None else moment.replace(tzinfo=datetime.UTC)
    since = utc - datetime.datetime(1970, 1, 1, tzinfo=datetime.UTC)
    return (since.days * 86_400 + since.seconds) * 1_000_000_000 + since.microseconds * 1000


def parsed(text: str, *, day_first: bool) -> datetime.datetime | None:
    """Return a complete date with a time of day in a text, by dateutil, with names in six languages.

    Args:
        text: At most 64 characters with four numbers at least.
        day_first: Whether the day comes before the month where both are numbers.

    Returns:
        The moment, with a zone if the text has one that is understood. None if the date or the time is
            incomplete: dateutil would then fill in the parts of a default.
    """
    if len(re.findall(r"\d+", text)) < _FEWEST_NUMBERS or len(text) > _LONGEST:
        return None
    parser = _parser()
    try:
        one, other = (
            parser.parse(text, dayfirst=day_first, default=default, tzinfos=_zone_s)
            for default in (datetime.datetime(1904, 2, 3), datetime.datetime(1905, 3, 4))
        )
    except (ValueError, OverflowError, TypeError):
        return None
    return one if one == other else None


def _zone_s(name: str | None, offset_s: int | None) -> int | None:
    """Return the offset of a zone in s, None for no zone. Raises `ValueError` for one not understood."""
    if offset_s is not None or name is None:
        return offset_s
    offset = offset_ns(name)
    if offset is None:
        raise ValueError(f"{name} is no zone")
    return offset // 1_000_000_000


@cache
def _parser() -> Any:
    """Return dateutil's parser with the names of months and weekdays in six languages."""
    from dateutil.parser import parser, parserinfo  # noqa: PLC0415 - of an extra

    class Names(parserinfo):  # type: ignore[misc]
        MONTHS: ClassVar = [
            ("jan", "january", "januar", "janvier", "enero", "gennaio"),
            (
                "feb",
                "february",
                "februar",
                "février",
                "fevrier",
                "fév",
                "fév.",
                "févr",
                "febrero",
                "febbraio",
            ),
            ("mar", "march", "märz", "mär", "mrz", "mars", "marzo"),
            ("apr", "april", "avril", "avr", "abril", "aprile"),
            ("may", "mai", "mayo", "maggio"),
            ("jun", "june", "juni", "juin", "junio", "giugno"),
            ("jul", "july", "juli", "juillet", "juil", "julio", "luglio"),
            ("aug", "august", "août", "aout", "agosto"),
            ("sep", "sept", "september", "septembre", "septiembre", "settembre"),
            ("oct", "october", "okt", "oktober", "octobre", "octubre", "ottobre"),
            ("nov", "november", "novembre", "noviembre"),
            ("dec", "december", "dez", "dezember", "déc", "décembre", "decembre", "diciembre", "dicembre"),
        ]
        WEEKDAYS: ClassVar = [
            ("mon", "monday", "mo", "montag", "lun", "lundi", "lunes", "lunedì"),
            ("tue", "tuesday", "tues", "di", "dienstag", "mardi", "martes", "martedì"),
            ("wed", "wednesday", "mi", "mittwoch", "mer", "mercredi", "miércoles", "mercoledì"),
            ("thu", "thursday", "thurs", "do", "donnerstag", "jeu", "jeudi", "jueves", "giovedì"),
            ("fri", "friday", "fr", "freitag", "ven", "vendredi", "viernes", "venerdì"),
            ("sat", "saturday", "sa", "samstag", "sonnabend", "sam", "samedi", "sábado", "sabato"),
            ("sun", "sunday", "so", "sonntag", "dim", "dimanche", "domingo", "domenica"),
        ]
        JUMP: ClassVar = [*parserinfo.JUMP, "uhr", "um", "le", "à", "de", "den"]

    return parser(Names())
