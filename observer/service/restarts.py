"""When the process is to be executed anew: for a changed configuration, or a clock that was set."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import structlog

from observer.errors import UserError
from observer.process.clock import stepped

SETTLED_S = 3.0
"""The new time of a reset clock is accepted once its offset has been stable for so long …"""
_SAME_S = 0.1
"""… to within this."""
LOOK_S = 2.0
"""Interval of looking for an adopted configuration."""
NOTICE_S = 600.0
"""A rejected configuration stays a reason in health for so long."""

Table = dict[str, Any]
log = structlog.get_logger()


class Restarts:
    """Watches the configuration and the computer's clock.

    A wrong configuration is a reason of health for ten minutes, and the one in force stays.

    Attributes:
        table: The configuration in force, and once a changed one is valid that one.
    """

    def __init__(
        self, check: Callable[[], Table], table: Table | None = None, adoption_record: Path | None = None
    ) -> None:
        """Start a thread that watches.

        Args:
            check: Reads and checks the configuration, in that thread; it raises `UserError` for a wrong one.
            table: The configuration in force; None for an empty one.
            adoption_record: A file whose change also calls `check`; None without.
        """
        self.table = table or {}
        self._check, self._record = check, adoption_record
        self._recorded_ns = self._record_ns()
        self._requested = threading.Event()
        self._reason: str | None = None
        self._refused: tuple[float, str] | None = None
        self._since_s: float | None = None
        self._offset_s = 0.0
        threading.Thread(target=self._watch, name="reload", daemon=True).start()

    def reload(self) -> None:
        """Have the configuration checked, beside the running service; from any thread, or a signal's handler.

        A request that comes while one is being checked is checked after it.
        """
        self._requested.set()

    @property
    def reload_pending(self) -> bool:
        """Whether a reload was requested that has not been checked."""
        return self._requested.is_set()

    def _watch(self) -> None:
        """Check the configuration when that is asked for, or when one was adopted, until one is valid."""
        while self._reason is None:
            is_requested = self._requested.wait(LOOK_S)
            recorded_ns, before_ns = self._record_ns(), self._recorded_ns
            self._recorded_ns = recorded_ns
            if is_requested or recorded_ns != before_ns:
                self._requested.clear()
                self._examine(
                    "the configuration was read again" if is_requested else "a configuration was adopted"
                )

    def _record_ns(self) -> int | None:
        """When the record of the last adoption was written, None without one."""
        try:
            return None if self._record is None else self._record.stat().st_mtime_ns
        except OSError:
            return None

    def _examine(self, reason: str) -> None:
        log.info("checking the configuration")
        try:
            self.table = self._check()
            self._refused, self._reason = None, reason
        except UserError as error:
            self._refuse(str(error))
        except Exception as error:  # the service continues with what it has, whatever this is
            log.error("checking the configuration failed", exc_info=True)
            self._refuse(repr(error))

    def _refuse(self, why: str) -> None:
        self._refused = (time.monotonic(), why)
        log.error("configuration rejected; the one in force stays", reason=why)

    def due(self, now_s: float, offset_s: float) -> str | None:
        """Return why a restart is due.

        A clock that was set counts once its offset has been stable for 3 s.

        Args:
            now_s: The time of the service.
            offset_s: How far the computer's clock is ahead, in s.

        Returns:
            The reason in words; None if no restart is due.
        """
        if self._reason is not None:
            return self._reason
        why = stepped(offset_s)
        if why is None:
            self._since_s = None
        elif self._since_s is None or abs(offset_s - self._offset_s) > _SAME_S:
            self._since_s, self._offset_s = now_s, offset_s
        elif now_s - self._since_s >= SETTLED_S:
            return why
        return None

    def notices(self) -> tuple[str, ...]:
        """Reasons for health."""
        if self._refused is None or time.monotonic() - self._refused[0] > NOTICE_S:
            return ()
        return (f"the new configuration was rejected, the old one is in force: {self._refused[1]}",)
