"""Output of verbs for people: progress, warnings, tables, and the sentence of an error."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, redirect_stdout
from io import StringIO
from shutil import get_terminal_size
from textwrap import fill
from typing import TYPE_CHECKING, Any, TextIO

from observer.errors import UserError
from observer.files.documents import result_text
from observer.process.terminal import echo, print_for_people, printable

if TYPE_CHECKING:
    from rich.console import RenderableType
    from rich.progress import Progress

LINE_S = 10.0
"""Least time between two lines of progress."""
_REGIMES = {
    "points": "the position of {name} is sampled fewer than 2.5 times per traverse; its heat is spread "
    "over the positions sampled in the last 20 s",
    "undetermined": "the position of {name} is sampled in step with its motion, so its path is not in the "
    "log; record it faster, with at least ten samples per traverse",
}


def print_error(error: UserError) -> None:
    """Print the sentence of the error that ends a command on standard error, after all earlier output."""
    sys.stdout.flush()
    echo(_fitted(f"observer: {error}", sys.stderr), err=True)


def warn(sentences: list[str]) -> None:
    """Print each sentence as a warning, on standard error, wrapped to the terminal's width."""
    for sentence in sentences:
        echo(_fitted(f"warning: {sentence}", sys.stderr), err=True)


def show_sentence(sentence: str) -> None:
    """Print a sentence on standard output, wrapped to the terminal's width."""
    echo(_fitted(sentence, sys.stdout))


def _fitted(text: str, stream: TextIO) -> str:
    """A text wrapped between words in a terminal; elsewhere unchanged."""
    if not stream.isatty():
        return text
    width = get_terminal_size().columns
    return "\n".join(
        fill(
            line, width, subsequent_indent=" " * (len(line) - len(line.lstrip())), break_long_words=False,
            break_on_hyphens=False,
        )
        for line in text.split("\n")
    )  # fmt: skip


def warn_of_paths(regimes: dict[str, str]) -> None:
    """Warn of the nuts whose path is not in the log.

    Args:
        regimes: By source, `path`, `points` or `undetermined`, as in `summary.json`.
    """
    for name, regime in regimes.items():
        if regime != "path":
            echo(f"warning: {_REGIMES[regime].format(name=name)}", err=True)


class _Shown:
    """Whether anything but warnings and errors is shown."""

    progress = True


@contextmanager
def silent() -> Iterator[None]:
    """Show no progress and print no prose during the block; warnings and errors, on standard error,
    remain.
    """
    _Shown.progress = False
    try:
        with redirect_stdout(StringIO()):
            yield
    finally:
        _Shown.progress = True


@contextmanager
def counting(name: str, doing: str, afterwards: str) -> Iterator[Callable[[int, int], None]]:
    """Show a bar for work of known length during the block, if standard error is a terminal.

    Args:
        name: The command.
        doing: Names the work until all rows are done.
        afterwards: Names the work after that.

    Yields:
        A function to call with the rows done and their total.
    """
    with _bar() as bar:
        task = bar.add_task(f"{name}: reading", total=None)

        def update(completed: int, total: int) -> None:
            phase = doing if completed < total else afterwards
            bar.update(task, completed=completed, total=total, description=f"{name}: {phase}")

        yield update


@contextmanager
def advancing(name: str) -> Iterator[Callable[..., None]]:
    """Show a bar for work in stages during the block.

    Where no terminal shows a bar, long work prints a line every 10 s.

    Args:
        name: The command.

    Yields:
        A function to call with the stage and, where known, the fraction done.
    """
    from rich.markup import escape

    with _bar() as bar:
        task = bar.add_task(name, total=None)
        print_line = lines(name) if bar.disable and _Shown.progress else None

        def update(text: str, share: float | None = None) -> None:
            total, shown = None if share is None else 1.0, f"{name}: {escape(printable(text))}"
            bar.update(task, completed=share, total=total, description=shown)
            if print_line is not None:
                print_line(text)

        yield update


def lines(name: str, clock: Callable[[], float] = time.monotonic) -> Callable[[str], None]:
    """Return a function that prints the stage of long work to standard error, at most every 10 s.

    Args:
        name: The command.
        clock: Gives the time in s.
    """
    begun_s = last_s = clock()

    def print_line(text: str) -> None:
        nonlocal last_s
        if (now_s := clock()) - last_s >= LINE_S:
            last_s = now_s
            echo(f"{name}: {text} ({now_s - begun_s:.0f} s)", err=True)

    return print_line


def _bar() -> Progress:
    """A bar on standard error, where somebody watches."""
    from rich.console import Console
    from rich.progress import Progress, TimeElapsedColumn

    console = Console(stderr=True)
    columns = *Progress.get_default_columns(), TimeElapsedColumn()
    watched = console.is_terminal and _Shown.progress
    return Progress(*columns, console=console, transient=True, disable=not watched)


def show(result: Any, as_json: bool, as_text: Callable[[Any], RenderableType]) -> None:
    """Print a result, as JSON for programs or as text for people.

    Args:
        result: The document, or an object that `as_text` lays out.
        as_json: Print JSON; `result` must then be a document.
        as_text: Lays it out for a terminal.
    """
    if as_json:
        echo(result_text(result))
        return
    print_for_people(as_text(result))
