"""Reads the ```console blocks of a Markdown page: commands after `$ `, then what they print.

In what is printed, `…` stands for anything, within a line or, alone on a line, for any number of lines.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

BLOCK = re.compile(
    r"^(?P<indent> *)```(?P<language>\S*)[^\n]*\n(?P<body>.*?)^(?P=indent)```\s*$", re.M | re.S
)
# Commands that run until they are stopped; a page must bound them.
ENDLESS = re.compile(r"\bobserver (run|demo|watch)\b|python -m observer (run|demo|watch)\b")
BOUNDED = re.compile(r"--seconds\b|\btimeout \d+|--once\b|--help\b")


@dataclass(frozen=True, slots=True)
class Command:
    """One command of a page and the output printed below it."""

    page: str
    line: int
    text: str
    expected: str


def blocks(page: Path) -> list[tuple[int, str, str]]:
    """(line, language, body) of each fenced block of a page."""
    text = page.read_text(encoding="utf-8")
    found = []
    for match in BLOCK.finditer(text):
        indent = match["indent"]
        body = "\n".join(line.removeprefix(indent) for line in match["body"].splitlines())
        found.append((text[: match.start()].count("\n") + 1, match["language"], body))
    return found


def commands(page: Path) -> list[Command]:
    """Every command of the page's ```console blocks, in order."""
    return [
        c for line, language, body in blocks(page) if language == "console" for c in _split(page, line, body)
    ]


def _split(page: Path, first: int, body: str) -> list[Command]:
    """A block's commands; a line that ends in a backslash goes on in the next."""
    found: list[Command] = []
    lines = body.splitlines()
    position = 0
    while position < len(lines):
        if not lines[position].startswith("$ "):
            raise ValueError(f"{page.name}:{first + 1 + position}: a console block must start with `$ `")
        start, text = position, lines[position][2:]
        while text.endswith("\\"):
            position += 1
            text = f"{text[:-1].rstrip()} {lines[position].strip()}"
        position += 1
        printed = position
        while position < len(lines) and not lines[position].startswith("$ "):
            position += 1
        found.append(Command(page.name, first + 1 + start, text, "\n".join(lines[printed:position])))
    return found


def bounded(command: Command) -> bool:
    """Whether the command ends by itself."""
    return not ENDLESS.search(command.text) or bool(BOUNDED.search(command.text))


_PROGRESS = r"^(identify|compare|calibrate|discover|place): .* \(\d+ s\)\n"


def without_progress(printed: str) -> str:
    """What was printed without the lines by which long work says, each ten seconds, how far it is."""
    return re.sub(_PROGRESS, "", printed, flags=re.MULTILINE)


def matches(expected: str, printed: str) -> bool:
    """Whether what was printed is what the page shows; blanks at the end of lines do not count."""
    pattern = ""
    for line in expected.strip().splitlines():
        if line.strip() == "…":
            pattern += r"(?:.*\n)*?"
        else:
            pattern += ".*".join(re.escape(part) for part in line.rstrip().split("…")) + r"[ \t]*\n"
    return re.fullmatch(pattern, printed.strip() + "\n") is not None
