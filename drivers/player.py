"""A recorded log played as if it were live."""

from __future__ import annotations

import asyncio
import dataclasses
import math
from typing import Literal

import numpy as np
from pydantic import Field, model_validator

from drivers.protocol import ChannelName, Clock, Deliver, Driver, DriverStatus, DriverTable, faulty
from observer.config.quantities import File, Finite
from observer.errors import LogError
from observer.files.logs import read_log
from observer.frames import Reading

SHORTEST_S = 0.005  # between the faults after the log's end


class PlayerSettings(DriverTable):
    """A recorded log played at its original speed as if it were live; `channels` defaults to all of it."""

    kind: Literal["player"]
    path: File
    speed: Finite = 1.0
    channels: tuple[ChannelName, ...] | None = Field(default=None, min_length=1)

    @model_validator(mode="after")
    def _in_its_own_rhythm(self) -> PlayerSettings:
        if self.speed != 1:
            raise ValueError(
                f"speed = {self.speed:g} would present the same heating in a different time; "
                "remove it, or use `observer replay`, which runs as fast as the computer can"
            )
        return self

    def open(self, name: str) -> Driver:
        """Read the log and make its player.

        Raises:
            LogError: If the log cannot be read or lacks a channel.
        """
        return Player(name, self)

    def file_problems(self, _name: str) -> list[str]:
        """Return the problem that prevents the log from being read, as a list of at most one sentence.

        The whole log is read, so an error in any of its lines is found.
        """
        try:
            read_log(self.path, self.channels or ())
        except LogError as error:
            return [f"path: {error}"]
        return []


class Player:
    """Plays the rows of a log at the intervals of their times; after the last row every channel is faulty.

    Rows are due by the injected clock, and get the times at which they were due.

    An empty cell is NaN with the fault `missing`. After the end the fault is `end_of_log`, each `period_s`.

    Attributes:
        period_s: The median interval of the log's rows, in s, at least 5 ms; 1 s for a single row.
    """

    def __init__(self, name: str, settings: PlayerSettings) -> None:
        log = read_log(settings.path)
        self.name = name
        self.channels = settings.channels if settings.channels is not None else log.channels
        unknown = [channel for channel in self.channels if channel not in log.channels]
        if unknown:
            raise LogError(
                f'{settings.path}: no column "{unknown[0]}"; the log has {", ".join(log.channels)}'
            )
        self._due_s = log.time_s - log.time_s[:1]
        self._values = log.values[:, [log.channels.index(channel) for channel in self.channels]]
        self.period_s = max(float(np.median(np.diff(self._due_s))), SHORTEST_S) if len(log) > 1 else 1.0
        self.status = DriverStatus()

    async def run(self, deliver: Deliver, now: Clock) -> None:
        """Deliver each row when it is due, then faults each period, until cancelled.

        Rows that are overdue come at once, one after the other, so that other tasks run between them.
        """
        start_s = now()
        self.status = dataclasses.replace(self.status, connected=True)
        for due_s, row in zip(self._due_s.tolist(), self._values.tolist(), strict=True):
            await asyncio.sleep(0.0)  # a row that is due lets others go first, too
            while (wait_s := start_s + due_s - now()) > 0:
                await asyncio.sleep(wait_s)
            values = dict(zip(self.channels, row, strict=True))
            faults = {channel: "missing" for channel, value in values.items() if math.isnan(value)}
            deliver(Reading(start_s + due_s, values, faults))
        self.status = dataclasses.replace(self.status, connected=False, last_error="the log has ended")
        while True:
            await asyncio.sleep(self.period_s)
            deliver(faulty(self.channels, "end_of_log", now()))
