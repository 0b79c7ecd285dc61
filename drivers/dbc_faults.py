"""The used messages of a DBC file that cannot be read as a whole.

Lines that describe other messages are made empty, so line numbers stay those of the file.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Iterator

_MESSAGE = re.compile(r"\s*BO_\s+(?P<id>\d+)\s+(?P<name>\w+)\s*:")
_SIGNAL = re.compile(r"\s*SG_\s")
_OF_MESSAGE = re.compile(r"\s*(?:SIG_VALTYPE_|SG_MUL_VAL_)\s+(?P<id>\d+)\s")
_ATTRIBUTE = re.compile(r'\s*BA_\s+"(?P<name>\w+)"\s+(?:BO_|SG_)\s+(?P<id>\d+)\s')
_LONG_NAME = re.compile(r'\s*BA_\s+"SystemMessageLongSymbol"\s+BO_\s+(?P<id>\d+)\s+"(?P<name>[^"]*)"')
_DEFINITION = re.compile(r'\s*BA_DEF_(?:DEF_)?\s+(?:BO_\s+|SG_\s+)?"(?P<name>\w+)"')
_OTHER = re.compile(
    r"\s*(?:VERSION|NS_|BS_|BU_|VAL_|VAL_TABLE_|CM_|BA_|BA_REL_|BA_DEF_|BA_DEF_REL_|BA_DEF_DEF_|BA_DEF_DEF_REL_|"
    r"BA_DEF_SGTYPE_|BA_SGTYPE_|BO_TX_BU_|EV_|ENVVAR_DATA_|EV_DATA_|SGTYPE_|SGTYPE_VAL_|SIG_GROUP_|SIG_TYPE_REF_|"
    r"SIGTYPE_VALTYPE_|CAT_DEF_|CAT_|FILTER|BU_EV_REL_|BU_SG_REL_|BU_BO_REL_)\b(?!\s+\d+\s+\w+\s*:)"
)
_DECODING_ATTRIBUTES = ("VFrameFormat", "SystemMessageLongSymbol", "SystemSignalLongSymbol")
"""The attributes that change how a frame is decoded or named."""


def message_names(text: str) -> list[str]:
    """Return the names of the messages in a DBC file; a long name replaces the short one.

    The order is that of the file, and a name that the file gives twice appears twice.
    """
    long_names = {m["id"]: m["name"] for m in map(_LONG_NAME.match, text.splitlines()) if m}
    messages = [m for m in map(_MESSAGE.match, text.splitlines()) if m]
    return [long_names.get(m["id"], m["name"]) for m in messages]


def lines_of_messages(text: str, names: Collection[str]) -> str:
    """Return the text of the file with only the lines that decode these messages.

    Args:
        text: The whole DBC file.
        names: Short or long names of the messages.

    Returns:
        As many lines as the file has; all others are empty, and `VERSION ""` precedes the first.
    """
    lines = text.splitlines()
    used = {
        match["id"]
        for line in lines
        for match in (_MESSAGE.match(line), _LONG_NAME.match(line))
        if match and match["name"] in names
    }
    defined = {match["name"] for match in map(_DEFINITION.match, lines) if match}
    return 'VERSION "" ' + "\n".join(_retained_lines(lines, used, defined & set(_DECODING_ATTRIBUTES))) + "\n"


def _retained_lines(lines: list[str], used: set[str], attributes: set[str]) -> Iterator[str]:
    """Yield each line unchanged if it is needed to decode a message in `used`, else an empty line.

    A line of an unknown kind stays if it may concern such a message, because it could change a value.
    """
    in_message = False
    for line in lines:
        if message := _MESSAGE.match(line):
            keep = in_message = message["id"] in used
        elif _SIGNAL.match(line):
            keep = in_message
        elif match := _OF_MESSAGE.match(line):
            keep, in_message = match["id"] in used, False
        elif match := _ATTRIBUTE.match(line):
            keep, in_message = match["id"] in used and match["name"] in attributes, False
        elif match := _DEFINITION.match(line):
            keep, in_message = match["name"] in attributes, False
        elif not line.strip() or _OTHER.match(line):
            keep = in_message = False
        else:
            keep = in_message or bool(used & set(re.findall(r"\d+", line)))
        yield line if keep else ""


def faulty_line(text: str, problem_of: Callable[[str], str | None]) -> tuple[int, str] | None:
    """Return the first line that makes the file unreadable.

    A signal is tried together with its message. So the message alone is read if the signal is at fault.

    Args:
        text: The file, as `lines_of_messages` returns it.
        problem_of: Returns why a text cannot be read, or None.

    Returns:
        The number of the line, from 1, and the problem; None if the file can be read.
    """
    lines = text.splitlines()
    tried = [""] * len(lines)
    for number, line in enumerate(lines, 1):
        if not line:
            continue
        tried[number - 1] = line
        if problem := problem_of("\n".join(tried) + "\n"):
            return number, problem
    return None
