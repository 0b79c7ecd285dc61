"""Counts names that say nothing and sentences that need a second reading; `make lint` runs it.

`python -m tests.plain_english` fails where a count is above its ceiling; `--show` lists every place. A place
is a hint: rename the thing, or rewrite the sentence from its meaning. A ceiling is what was reached; lower it
with each improvement.
"""

from __future__ import annotations

import argparse
import ast
import re
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).parents[1]
CODE = ("observer", "drivers")
PAGES = ("README.md", "CONTRIBUTING.md", "SECURITY.md", "CHANGELOG.md", "docs")

# Participles, pronouns and adverbs as names: they say how a thing came about, not what it is.
VAGUE_NAMES = frozenset(
    re.findall(
        r"\w+",
        """
        about again all_of alone anew anything around arrived asked beside beyond came done each
        earlier every few found given gone had has have having held here how how_many how_much
        kept knows known later less made may_go mine more much needed none nothing once own own_
        put said says seen several some something stands such taken tells then there those
        together told took wanted what when where whether which who whom whose why wished within
        yours
        """,
    )
)
DOCUMENTED = ast.Module | ast.ClassDef | ast.FunctionDef
LONGEST_WORDS = 30
HARD_SENTENCES = {
    "a clause as subject": re.compile(r"^(?:What|Who|Whoever|Whatever|That which|Those who|Of) (?!is\b)\w+"),
    "a clause as object": re.compile(r"\b(?:of|for|by|with|from|than|beside|after|before) (?:what|who) \w+"),
    "nothing as predicate": re.compile(r"\b(?:is|are|was|were) (?:none|nothing|no [a-z]+)\b"),
    "a thing that speaks": re.compile(
        r"\b(?:estimate|file|filter|key|law|log|machine|model|page|readings?|screw|sensors?|table|values?) "
        r"(?:asks?|knows?|says?|sees|speaks?|tells?|thinks?)\b"
    ),
    "two relative clauses": re.compile(r"\b(?:which|whose)\b.*\b(?:of|by|to|from|in|with) which\b"),
    "dialect": re.compile(r"\b(?:aloud|by itself|give or take|in vain|otherwise than|worked out)\b"),
}


class Place(NamedTuple):
    """A finding: the file with its line, and what is wrong there."""

    file: Path
    line: int
    problem: str


class Count(NamedTuple):
    """The places that one check has counted among `size` lines or words, and its ceiling per thousand."""

    kind: str
    places: list[Place]
    size: int
    ceiling: float

    @property
    def per_thousand(self) -> float:
        return 1000.0 * len(self.places) / max(self.size, 1)


def named(tree: ast.AST) -> Iterator[tuple[int, str]]:
    """Yield the line and name of every variable, parameter, function and class that a file defines."""
    for node in ast.walk(tree):
        match node:
            case ast.Name(id=name, ctx=ast.Store(), lineno=line):
                yield line, name
            case ast.arg(arg=name, lineno=line):
                yield line, name
            case ast.FunctionDef(name=name, lineno=line) | ast.ClassDef(name=name, lineno=line):
                yield line, name


def docstrings(tree: ast.AST) -> Iterator[tuple[int, str]]:
    """Yield the line and text of every docstring."""
    for node in ast.walk(tree):
        if isinstance(node, DOCUMENTED) and (text := ast.get_docstring(node)):
            yield node.body[0].lineno, text


def paragraphs(text: str) -> Iterator[tuple[int, str]]:
    """Yield the first line and the words of each paragraph and list item.

    Code, tables, headings and pictures are left out.
    """
    is_code, first, words = False, 0, ""
    for number, line in enumerate([*text.splitlines(), ""]):
        is_fence = line.lstrip().startswith("```")
        is_code ^= is_fence
        is_prose = not (is_code or is_fence or line.startswith(("    ", "|", "#", "<", "!")))
        item = re.match(r"\s*(?:[-•]|\d+\.) ", line)
        if words and (item or not is_prose or not line.strip()):
            yield first, words
            words = ""
        if is_prose and line.strip():
            first = first if words else number
            words = f"{words} {line[item.end() :] if item else line.strip()}".strip()


def sentences(text: str) -> Iterator[tuple[int, str]]:
    """Yield each sentence with the first line of its paragraph; code in it is one word."""
    for line, words in paragraphs(text):
        plain = re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", words)
        plain = re.sub(r"`[^`]*`", "code", plain).replace("*", "")
        for sentence in re.split(r"(?<=[.!?:;]) +(?=[A-Z(])", plain):
            yield line, sentence


def problems(sentence: str) -> Iterator[str]:
    """Yield what makes a sentence hard to read."""
    yield from (name for name, pattern in HARD_SENTENCES.items() if pattern.search(sentence))
    if (count := len(sentence.split())) > LONGEST_WORDS:
        yield f"{count} words"


def of_names(ceiling: float) -> Count:
    """Return the vague names of the product, per thousand lines."""
    places, size = [], 0
    for file in files(CODE, "*.py"):
        source = file.read_text(encoding="utf-8")
        size += source.count("\n")
        vague = [(line, name) for line, name in named(ast.parse(source)) if name.strip("_") in VAGUE_NAMES]
        places += [Place(file, line, f"the name {name}") for line, name in vague]
    return Count("vague names", places, size, ceiling)


def of_sentences(kind: str, ceiling: float, texts: Iterator[tuple[Path, int, str]]) -> Count:
    """Return the hard sentences of some texts, per thousand words."""
    places, size = [], 0
    for file, first, text in texts:
        for line, sentence in sentences(text):
            size += len(sentence.split())
            places += [Place(file, first + line, f"{problem}: {sentence}") for problem in problems(sentence)]
    return Count(kind, places, size, ceiling)


def files(parts: tuple[str, ...], pattern: str) -> Iterator[Path]:
    """Yield the files of some parts of the project."""
    for part in parts:
        path = ROOT / part
        yield from sorted(path.rglob(pattern)) if path.is_dir() else [path]


def all_docstrings() -> Iterator[tuple[Path, int, str]]:
    """Yield file, line and text of every docstring of the product."""
    for file in files(CODE, "*.py"):
        for line, text in docstrings(ast.parse(file.read_text(encoding="utf-8"))):
            yield file, line, text


def all_pages() -> Iterator[tuple[Path, int, str]]:
    """Yield file, first line and text of every page."""
    for file in files(PAGES, "*.md"):
        yield file, 1, file.read_text(encoding="utf-8")


def main() -> int:
    """Print what was counted; return 1 where it is above its ceiling."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--show", action="store_true", help="list every place")
    shows = parser.parse_args().show
    counts = [
        of_names(CEILINGS["names"]),
        of_sentences("hard sentences of docstrings", CEILINGS["docstrings"], all_docstrings()),
        of_sentences("hard sentences of pages", CEILINGS["pages"], all_pages()),
    ]
    too_many = [count for count in counts if count.per_thousand > count.ceiling]
    for count in counts:
        print(f"{count.kind}: {count.per_thousand:.2f} per thousand, at most {count.ceiling}")
    for count in counts if shows else too_many:
        print(*(f"{p.file.relative_to(ROOT)}:{p.line}: {p.problem}" for p in count.places), sep="\n")
    return int(bool(too_many))


CEILINGS = {"names": 0.9, "docstrings": 1.4, "pages": 1.4}

if __name__ == "__main__":
    sys.exit(main())
