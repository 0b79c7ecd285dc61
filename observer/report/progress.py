"""Progress of long commands on standard error; silent where nobody watches."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    ProgressColumn,
    TaskProgressColumn,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)


@contextmanager
def counting(name: str) -> Iterator[Callable[[int, int], None]]:
    """A bar for work of known length: call with the rows done and their total."""
    with _bar(MofNCompleteColumn(), TimeRemainingColumn()) as bar:
        task = bar.add_task(name, total=None)
        yield lambda done, total: bar.update(task, completed=done, total=total)


@contextmanager
def advancing(name: str) -> Iterator[Callable[[str, float], None]]:
    """A bar for work in stages: call with what is being done and the part of all that lies behind."""
    with _bar(TaskProgressColumn(), TimeElapsedColumn()) as bar:
        task = bar.add_task(name, total=1.0)
        yield lambda text, done: bar.update(task, completed=done, description=f"{name}: {text}")


def _bar(*more: ProgressColumn) -> Progress:
    columns, console = (TextColumn("{task.description}"), BarColumn(), *more), Console(stderr=True)
    return Progress(*columns, console=console, transient=True, disable=not console.is_terminal)


@contextmanager
def saying(name: str) -> Iterator[Callable[[str], None]]:
    """A line that says what is being done."""
    console = Console(stderr=True)
    if not console.is_terminal:
        yield lambda _text: None
        return
    with console.status(name) as status:
        yield lambda text: status.update(f"{name}: {text}")
