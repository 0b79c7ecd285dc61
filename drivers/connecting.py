"""Why a device cannot be reached: one sentence with the remedy."""

from __future__ import annotations

import errno
import re

from observer.files.regular import one_line

_NUMBERED = re.compile(r"\[Errno (-?\d+)\]")
_NO_ANSWER = (
    "{place} does not answer: check that the device is on, its cable and address, and that this computer is "
    "in the same network"
)
_NO_NAME = "no computer has the name in {place}: correct it, or write the address in numbers"
_NOT_ALLOWED = "this user may not open {place}: add it to the group that ls -l {place} shows; log in again"
_SENTENCES = {
    errno.ECONNREFUSED: "nothing listens at {place}: check address and port, and whether the device is on",
    errno.ENODEV: "there is no {place}: plug the adapter in, or bring the interface up with "
    "ip link set {place} up",
    errno.ENOENT: "there is no {place}: plug the adapter in, or correct the name",
    errno.EACCES: _NOT_ALLOWED,
    errno.EPERM: _NOT_ALLOWED,
    errno.EBUSY: "another program uses {place}: end it; only one can have a serial port",
    **dict.fromkeys((errno.EHOSTUNREACH, errno.ENETUNREACH, errno.ETIMEDOUT, errno.EHOSTDOWN), _NO_ANSWER),
    **dict.fromkeys((-2, -3, -5), _NO_NAME),
}  # fmt: skip
"""By the number of the system's error; those of a name that is not known are negative."""


def why_not_opened(error: BaseException, place: str) -> str:
    """Return why a connection was not opened, with the remedy.

    The system's error number is looked up in the error, in its text and in its causes, since a library may
    wrap the socket's error. An error without an entry in the table is quoted in its own words.

    Args:
        error: The exception of the attempt.
        place: A host with its port, or a serial port.

    Returns:
        One sentence that names the place.
    """
    at: BaseException | None = error
    while at is not None:  # a library may wrap the socket's error
        numbers = [getattr(at, "errno", None), *map(int, _NUMBERED.findall(str(at)))]
        for number in numbers:
            if number in _SENTENCES:
                return _SENTENCES[number].format(place=place)
        at = at.__cause__ or at.__context__
    if isinstance(error, TimeoutError):
        return _NO_ANSWER.format(place=place)
    return f"{place} cannot be opened: {one_line(str(error)) or type(error).__name__}"
