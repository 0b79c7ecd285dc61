"""The service's access to the past: each query is answered by a process of low priority that ends with it."""

from __future__ import annotations

import json
import subprocess
import sys
import threading
from collections.abc import Mapping
from pathlib import Path

from observer.bus.exchange import PastReply

_PATIENCE_S = 30.0
_MOST_WAITING = 4
_REFUSED = 2


class PastProcess:
    """Queries the past of an axis; from any thread, one query at a time.

    At most four queries are accepted at once, the waiting ones included; a further one is refused. A query
    blocks its caller for up to 30 s of reading, and never the service's loop.
    """

    def __init__(self, folder: Path, name: str, in_force: str, period_s: float) -> None:
        """Take the recordings' folder, `<machine>-<axis>`, the hash of the configuration, and the period."""
        self._command = (sys.executable, "-m", "observer.service.past_process", "answer", str(folder), name)
        self._question = {"in_force": in_force, "gap_s": 2.5 * period_s}
        self._lock, self._waiting = threading.Lock(), threading.BoundedSemaphore(_MOST_WAITING)
        self._child: subprocess.Popen[bytes] | None = None
        self._is_closed = False

    def ask(self, key: str, parameters: Mapping[str, str]) -> PastReply:
        """Ask for a page of `estimate` or `readings`, and wait for the answer.

        Args:
            key: `estimate` or `readings`.
            parameters: `from`, `to` and `every`, as in the selector of the query.

        Returns:
            The page, CBOR for estimates and JSON for readings, or a sentence why there is none. Nothing is
                raised.
        """
        if not self._waiting.acquire(blocking=False):
            return PastReply(b"", "too many requests at once; ask again in a second")
        try:
            with self._lock:
                return self._ask(json.dumps(self._question | {"key": key, "asked": parameters}).encode())
        finally:
            self._waiting.release()

    def _ask(self, question: bytes) -> PastReply:
        if self._is_closed:
            return PastReply(b"", "the service ends")
        pipe = subprocess.PIPE
        with subprocess.Popen(
            self._command, stdin=pipe, stdout=pipe, stderr=pipe, start_new_session=True
        ) as child:
            self._child = child
            try:
                page, words = child.communicate(question, _PATIENCE_S)
            except subprocess.TimeoutExpired:
                child.kill()
                return PastReply(b"", "the past could not be read in time; ask for less")
        if child.returncode == 0:
            return PastReply(page)
        if child.returncode == _REFUSED:
            return PastReply(b"", words.decode())
        return PastReply(b"", "the query failed; ask for another span")

    def close(self) -> None:
        """Kill a query that runs, and refuse all later ones."""
        self._is_closed = True
        if (child := self._child) is not None and child.poll() is None:
            child.kill()
