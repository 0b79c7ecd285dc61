"""Dates in the header of an `.asc` recording, which its recorder writes in the language of its computer.

python-can reads English and a few German dates, and silently takes any other for 1970.
"""

from __future__ import annotations

import re
import unicodedata
from datetime import datetime

# The first letters of the months in English, German, French, Italian, Spanish, Portuguese, Dutch, Swedish,
# Danish, Norwegian and Polish, without accents; `juin` and `juil` need four.
_MONTHS = {
    stem: number
    for number, stems in enumerate(
        ["jan gen ene sty", "feb fev lut", "mar mrz mrt maa", "apr avr abr kwi", "may mai mag maj mei",
         "jun juin giu cze", "jul juil lug lip", "aug aou ago sie", "sep set wrz", "oct okt ott out paz",
         "nov lis", "dec dez dic des gru"],
        1,
    )
    for stem in stems.split()
}  # fmt: skip
_DATED = re.compile(r"\s*(?P<head>date|begin\s+triggerblock)\s+(?P<date>\S.*?)\s*$", re.IGNORECASE)
_CLOCK = re.compile(
    r"(?P<H>\d{1,2}):(?P<M>\d{2}):(?P<S>\d{2})(?:[.,](?P<f>\d{1,6}))?(?:\s*(?P<half>[AaPp])\.?\s?[Mm]\b\.?)?"
)
_NUMBERS = re.compile(r"(?P<d>\d{1,2})(?P<sep>[./-])(?P<m>\d{1,2})(?P=sep)(?P<y>\d{4})")
_ISO = re.compile(r"(?P<y>\d{4})-(?P<m>\d{1,2})-(?P<d>\d{1,2})")


def is_dated(line: str) -> bool:
    """Whether a line of an `.asc` begins a recording or one of its blocks with a date.

    Such a line begins with `date` or `begin triggerblock`, in any case of letters.
    """
    return _DATED.match(line) is not None


def in_english(line: str) -> str | None:
    """Return the line with its date in the form that python-can reads.

    Months are understood in eleven languages, and numbers as year-month-day or with dots. A date such as
    3/4/2026 is not understood, because the order of day and month is uncertain.

    Returns:
        A line with its end; None if the line has no date or the date is not understood.
    """
    if (dated := _DATED.match(line)) is None:
        return None
    moment = _moment(dated["date"])
    if moment is None:
        return None
    return f"{dated['head']} Day {moment:%m %d %H:%M:%S.%f %Y}\n"


def _moment(text: str) -> datetime | None:
    """Return date and time of day from the text of a header line; None if either is missing or invalid."""
    clock = _CLOCK.search(text)
    if clock is None:
        return None
    hour, half = int(clock["H"]), (clock["half"] or "").lower()
    if half:
        hour = hour % 12 + (12 if half == "p" else 0)
    day = _day(text[: clock.start()] + " " + text[clock.end() :])
    if day is None:
        return None
    try:
        fraction = int((clock["f"] or "0").ljust(6, "0"))
        return datetime(*day, hour, int(clock["M"]), int(clock["S"]), fraction)
    except ValueError:
        return None


def _day(text: str) -> tuple[int, int, int] | None:
    """Return year, month and day; None where their order is not certain, as in 3/4/2026."""
    if numbers := _ISO.search(text) or _NUMBERS.search(text):
        if numbers.re is _NUMBERS and numbers["sep"] != ".":
            return None
        return int(numbers["y"]), int(numbers["m"]), int(numbers["d"])
    plain = unicodedata.normalize("NFKD", text.lower())
    words = re.findall(r"[a-z]{3,}", "".join(c for c in plain if not unicodedata.combining(c)))
    days, years = re.findall(r"\b\d{1,2}\b", text), re.findall(r"\b\d{4}\b", text)
    if not words or len(days) != 1 or len(years) != 1:
        return None
    month = _MONTHS.get(words[-1][:4]) or _MONTHS.get(words[-1][:3])
    return None if month is None else (int(years[0]), month, int(days[0]))
