"""Signals that are put off while something is started."""

from __future__ import annotations

import signal
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def unheard(*numbers: signal.Signals) -> Iterator[None]:
    """Put signals off; threads and processes that are started within do not hear them at all."""
    before = signal.pthread_sigmask(signal.SIG_BLOCK, numbers)
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
