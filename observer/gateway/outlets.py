"""Where the service's messages go: to Zenoh, and the same bytes to the gateway."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from observer.exchange import Command, PublishStatus
from observer.frames import EstimateBlock, FrameBlock
from observer.gateway.feed import Feed
from observer.publish.zenoh import ZenohPublisher


class Outlets:
    """A publisher with a gateway beside it."""

    def __init__(self, publisher: ZenohPublisher, feed: Feed) -> None:
        self._publisher = publisher
        self._feed = feed
        publisher.tap = feed.put

    @property
    def status(self) -> PublishStatus:
        """How publishing stands; an outlet's reason where Zenoh has none."""
        status = self._publisher.status
        return replace(status, reason=status.reason or self._feed.reason)

    def start(self) -> None:
        """Begin to open the session and to start the gateway."""
        self._publisher.start()
        self._feed.start()

    def commands(self) -> list[Command]:
        """The commands that came since the last call, by either way."""
        return self._publisher.commands() + self._feed.commands()

    def publish(self, block: EstimateBlock, sequence: int) -> None:
        """Publish a block of one estimate."""
        self._publisher.publish(block, sequence)

    def readings(self, frame: FrameBlock, sequence: int) -> None:
        """Publish what the estimate was made of."""
        self._publisher.readings(frame, sequence)

    def health(self, document: Mapping[str, Any]) -> None:
        """Publish a health document."""
        self._publisher.health(document)

    def alarms(self, document: Mapping[str, Any]) -> None:
        """Publish an alarms document."""
        self._publisher.alarms(document)

    def forecast(self, document: Mapping[str, Any]) -> None:
        """Publish a forecast."""
        self._publisher.forecast(document)

    def compensation(self, document: Mapping[str, Any]) -> None:
        """Publish a compensation document."""
        self._publisher.compensation(document)

    def close(self, timeout_s: float) -> bool:
        """End gateway and session; says whether the session was closed in that time."""
        self._feed.close(timeout_s / 2)
        return self._publisher.close(timeout_s / 2)
