"""Says in words why a line is not TOML, and how to write it.

Each slip that people make has a repair. A repair is proposed only if the parser then accepts the line.
"""

from __future__ import annotations

import itertools
import re
import tomllib
from collections.abc import Callable, Iterator

from observer.units import spelled

_AT_LINE = re.compile(r"\(at line (\d+), column \d+\)")
_COMMENT = re.compile(r"""((?:[^#"']|"(?:[^"\\]|\\.)*"|'[^']*')*)(#.*)?""", re.DOTALL)
_MOST_SHOWN, _MOST_LINE, _MOST_TEXT = 80, 300, 100_000
_YES, _NO = ("true", "yes", "on", "ja", "ein", "wahr"), ("false", "no", "off", "nein", "aus", "falsch")
_NUMBER = r"[+-]?\d+(?:[.,]\d+)?(?:[eE][+-]?\d+)?"
_WITH_UNIT = re.compile(rf"({_NUMBER})\s*([^\d\s.\"',;\[\]{{}}][^\"',;\[\]{{}}]*)")


def sentence(text: str, reason: str) -> str:
    """Return the first line of a text that is not TOML, quoted, with its repair.

    Args:
        text: The text.
        reason: The parser's message; it is repeated where no slip explains the line.
    """
    at_line = _AT_LINE.search(reason)
    if at_line is None:
        return f"not valid TOML ({reason}); correct the end of the file"
    lines, number = text.split("\n"), int(at_line[1]) - 1
    if number >= len(lines):
        return f"not valid TOML ({reason}); fix that line"
    candidates = [number]
    if "Unclosed" in reason or not lines[number].strip():  # the slip stands above the line of the message
        candidates += list(range(number - 1, max(number - 6, -1), -1))
    for at in candidates if len(text) <= _MOST_TEXT else ():
        if lines[at].strip() and (repair := _repaired(lines, at, number)):
            return f"line {at + 1} is not valid TOML: {_shown(lines[at])}; {repair}"
    words = _twice(lines, number) or _WITHOUT_REPAIR.get(
        reason.partition(" (")[0], f"({reason}); fix that line"
    )
    return f"line {number + 1} is not valid TOML: {_shown(lines[number])}; {words}"


def _repaired(lines: list[str], at: int, number: int) -> str:
    """Say how to write line `at`, so that the parser passes line `number`; empty where no repair does that.

    One repair is tried, then two together.
    """
    if len(lines[at]) > _MOST_LINE:
        return ""
    single = list(_repairs(lines[at].rstrip("\r"), lines, at))
    double = (
        (f"{first}, and {second}", repaired_twice)
        for first, repaired_once in single
        for second, repaired_twice in _repairs(repaired_once, lines, at)
    )
    for words, repaired in itertools.chain(single, double):
        if _accepts("\n".join([*lines[:at], repaired, *lines[at + 1 :]]), max(at, number)):
            return f"{words}: write {_shown(repaired)}"
    return ""


def without_quotes(key: str, text: str) -> str:
    """Return the number that a text stands for, in the unit of a key.

    Args:
        key: Ends with its unit, such as `length_m`.
        text: A number, with a decimal comma or point, and perhaps a unit: `12 mm` of `length_m` is 0.012.

    Returns:
        The number as text; empty if the text is no number, or its unit cannot be converted.
    """
    match = re.fullmatch(rf"{_WITH_UNIT.pattern}|({_NUMBER})", text.strip())
    if match is None:
        return ""
    number, unit = (match[1] or match[3]).replace(",", "."), (match[2] or "").strip()
    target = key.rsplit("_", 1)[-1]
    if not unit or unit == target:
        return number
    if unit == "%":
        return f"{float(number) / 100.0:.9g}"
    written = spelled(unit)
    is_convertible = written is not None and written.base == target in ("m", "s", "degC")
    return f"{written.to_base(float(number)):.9g}" if written is not None and is_convertible else ""


def truth(text: str) -> str:
    """Return `true` or `false` for a word that people write for it, such as `yes` or `aus`; empty for any
    other.
    """
    word = text.strip().lower()
    return "true" if word in _YES else "false" if word in _NO else ""


def _accepts(text: str, number: int) -> bool:
    """Whether the parser finds no fault up to the line with this number, counted from 0."""
    try:
        tomllib.loads(text)
    except ValueError as error:
        at_line = _AT_LINE.search(str(error))
        return at_line is not None and int(at_line[1]) - 1 > number
    return True


def _shown(line: str) -> str:
    code = (_COMMENT.fullmatch(line) or [line, line])[1].strip() or line.strip()
    plain = "".join(c if c.isprintable() else " " for c in code)
    return plain if len(plain) <= _MOST_SHOWN else f"{plain[: _MOST_SHOWN - 1]}…"


def _repairs(line: str, lines: list[str], at: int) -> Iterator[tuple[str, str]]:
    """Propose lines in place of one: what is wrong with it, and the line."""
    straight = line.translate(_STRAIGHT)
    if straight != line:
        yield "use the plain quotes, minus and blanks of the keyboard", straight
    split = _COMMENT.fullmatch(straight)
    code, comment = (split[1].rstrip(), split[2] or "") if split else (straight.rstrip(), "")
    end = f"  {comment}" if comment else ""
    if code.count("{") > code.count("}"):
        joined = code
        for below in lines[at + 1 : at + 9]:
            joined += f" {below.strip()}"
            if "}" in below:
                yield "a table in braces stands in one line", joined
                break
    for words, repair in _LINE_REPAIRS:
        for repaired in _several(repair(code)):
            if repaired != code:
                yield words, repaired + end


def _several(repaired: str | list[str]) -> list[str]:
    return [repaired] if isinstance(repaired, str) else repaired


_STRAIGHT = str.maketrans(
    dict.fromkeys("“”„‟″«»＂", '"') | dict.fromkeys("‘’‚‛′", "'") | dict.fromkeys("−–—", "-")
    | dict.fromkeys("\u00a0\u2007\u2009\u202f\u3000", " ") | dict.fromkeys("\ufeff\u200b", "") | {"＝": "="}
)  # fmt: skip


def _value(change: Callable[[str, str], str]) -> Callable[[str], str]:
    """Return a repair that changes the value after the first `=`, by its key."""

    def repair(code: str) -> str:
        head, equals, value = code.partition("=")
        if not equals or not value.strip():
            return code
        return f"{head}= {change(head.strip(), value.strip())}"

    return repair


def _decimal_point(key: str, value: str) -> str:
    del key
    if re.fullmatch(r"[+-]?\d{1,3}(\.\d{3})+,\d+", value):
        return value.replace(".", "").replace(",", ".")
    return re.sub(r"(?<=\d),(?=\d)", ".", value)


def _number_alone(key: str, value: str) -> str:
    return without_quotes(key, value) if _WITH_UNIT.fullmatch(value) else value


def _as_number(key: str, value: str) -> str:
    del key
    hexadecimal = re.fullmatch(r"(?:0X|\$)?([0-9A-Fa-f]+)[hH]?", value)
    if hexadecimal and not value.isdigit():
        return f"0x{hexadecimal[1]}"
    value = re.sub(r"\s*[·*x×]\s*10\s*\^?\s*\(?([+-]?\d+)\)?", r"e\1", value)
    value = re.sub(r"(?<![\w.])0+(?=\d)(?!x)", "", value)
    return re.sub(r"(?<=\d)\.(?!\d)", ".0", re.sub(r"(?<!\d)\.(?=\d)", "0.", value))


def _quotes(key: str, value: str) -> str:
    del key
    inner = value.strip("\"'")
    plain = inner and not set(inner) & set('"\\[]{}=;') and (inner[0].isalpha() or inner.count(".") > 1)
    return f'"{inner}"' if plain or re.fullmatch(r"/[^\"\\;=]+", inner) else value


def _quotes_inside(code: str) -> str:
    """Quote the bare words among the values of a list or of a table in braces."""
    return re.sub(
        r"(?<=[=\[,])(\s*)\"?([A-Za-z][\w.:/ -]*?)\"?(?=\s*[,\]}])",
        lambda m: m[0] if m[2] in ("true", "false") else f'{m[1]}"{m[2]}"',
        code,
    )


def _list(key: str, value: str) -> str:
    del key
    inner = re.sub(r"^\s*[\[({]|[\])}]\s*$", "", value).strip().rstrip(",;")
    decimal = re.sub(r"(?<=\d),(?=\d)", ".", inner)
    parts = [part for part in re.split(r"[;\s]\s*|,\s+", decimal) if part]
    if len(parts) == 1:
        parts = [part.strip() for part in inner.split(",")]
    return f"[{', '.join(parts)}]" if parts and all(re.fullmatch(_NUMBER, part) for part in parts) else value


def _header(code: str) -> str:
    match = re.fullmatch(r"\s*(\[+|\(|<|\{)\s*([^\[\]]+?)\s*(\]*|\)|>|\})\s*:?", code)
    if match is None or "=" in code:
        return code
    twice = len(match[1]) > 1 or len(match[3]) > 1
    name = ".".join(part.strip() for part in match[2].split("."))
    return f"[[{name}]]" if twice else f"[{name}]"


def _quoted_key(code: str) -> str:
    """Quote the parts of a key, or of a table's name, that have other characters than bare ones may."""
    match = re.fullmatch(r"(\s*\[*\s*)([^=\[\]\"']+?)(\s*(?:\]+|=.*))", code)
    if match is None:
        return code
    parts = [p.strip() for p in match[2].split(".")]
    parts = [p if re.fullmatch(r"[A-Za-z0-9_-]+", p) else f'"{p}"' for p in parts]
    return f"{match[1]}{'.'.join(parts)}{match[3]}"


def _hash_comment(code: str) -> list[str]:
    return [re.sub(rf"(^|\s)\s*{mark}\s?", r"\1# ", code, count=1) for mark in ("//", ";", "--", "!", "REM ")]


def _truth_alone(key: str, value: str) -> str:
    del key
    return truth(value) or value


_LINE_REPAIRS: tuple[tuple[str, Callable[[str], str | list[str]]], ...] = (
    ("a number has a decimal point, not a comma", _value(_decimal_point)),
    ("a line ends without comma or semicolon", lambda code: re.sub(r"\s*[,;]+$", "", code)),
    ("the unit is in the key's name; write the number alone, in that unit", _value(_number_alone)),
    ("write true or false in small letters, without quotes", _value(_truth_alone)),
    ("TOML writes this number differently", _value(_as_number)),
    ("several numbers stand in square brackets, with commas between them", _value(_list)),
    ("a table's name stands in square brackets", _header),
    ("a comment begins with #", _hash_comment),
    ("a backslash has a meaning of its own; write / in paths", lambda code: code.replace("\\", "/")),
    ("a key and its value are joined by =", lambda code: [
        re.sub(r"(?<=[\w\"])\s*(?::=|=>|==|:)\s*", " = ", code, count=n) for n in (1, 0)]),
    ("text stands in quotes, at both ends", _value(_quotes)),
    ("text stands in quotes, at both ends", _quotes_inside),
    ("a name has no blanks", lambda code: re.sub(r"(?<=\w) +(?=\w[^=]*=)", "_", code)),
    ("a name with other signs than letters, digits, _ and - stands in quotes", _quoted_key),
    ("entries are separated by commas", lambda code: re.sub(
        r"(?<=[\w\"])\s*;\s*|(?<=[\d\"])\s+(?=[\d\"-])", ", ", code)),
    ("close the bracket", lambda code: [code + close for close in ("]", "}", "]]")]),
)  # fmt: skip
"""What is wrong with a line, and the repair of what stands before its comment."""
_WITHOUT_REPAIR = {
    "Invalid value": "the value behind = is missing or not readable: write a number, true, false, or text "
    "in quotes",
    "Expected '=' after a key in a key/value pair": "write a key, = and its value; a comment begins with #",
    "Invalid statement": "write a key, = and its value; a comment begins with #",
}


def _twice(lines: list[str], number: int) -> str:
    """Say where what a line defines is defined already; empty where that is not the trouble."""
    code = _shown(lines[number])
    name = code.strip("[] ")
    if code.startswith("["):
        others = [(at, _shown(line)) for at, line in enumerate(lines[:number]) if _is_header(line, name)]
        if not others:
            return ""
        at, first = others[0]
        if first.startswith("[[") != code.startswith("[["):
            return f"line {at + 1} has {first}; where there may be several, write [[{name}]] each time"
        return f"line {at + 1} has {first} already; put the keys of both into one table"
    key = code.partition("=")[0].strip()
    for at in range(number - 1, -1, -1):
        above = _shown(lines[at])
        if above.startswith("["):
            break
        if above.partition("=")[0].strip() == key and "=" in above:
            return f"{key} is given in line {at + 1} already; remove one of them"
    return ""


def _is_header(line: str, name: str) -> bool:
    code = _shown(line)
    return code.startswith("[") and code.endswith("]") and code.strip("[] ") == name
