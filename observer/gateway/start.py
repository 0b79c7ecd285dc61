"""The first message to the gateway's process, and the reports of its outlets to the service."""

from __future__ import annotations

import asyncio
import json
import sys
import threading
from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pydantic import BaseModel, ConfigDict

from observer.steps.store import Past
from observer.tables.gateway import Metrics, Mqtt, Opcua, Page

if TYPE_CHECKING:
    from observer.installation import Installation


class Start(BaseModel):
    """The outlets to serve, with their settings.

    `recordings` is the folder of the recordings; `laws` are the sources with a heat law; `forecast_s` is the
    interval of forecasts, None without.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    machine: str
    axis: str
    period_s: float
    page: Page | None = None
    metrics: Metrics | None = None
    mqtt: Mqtt | None = None
    opcua: Opcua | None = None
    recordings: Path | None = None
    laws: tuple[str, ...] = ()
    forecast_s: float | None = None

    @classmethod
    def of(cls, config: Installation, *, forecasts: bool) -> Start | None:
        """Return the start of a configuration's outlets, None without any; with `forecasts` if some come."""
        outlets = {name: getattr(config, name) for name in OUTLETS}
        if all(outlet is None for outlet in outlets.values()):
            return None
        return cls(
            machine=config.machine.name,
            axis=config.machine.axis,
            period_s=config.estimator.period_s,
            recordings=None if (folder := config.record.directory) is None else folder.absolute(),
            laws=tuple(source.name for source in config.source if source.law is not None),
            forecast_s=config.forecast.period_s if forecasts else None,
            **outlets,
        )

    @property
    def past(self) -> Past | None:
        """The published steps of the axis, None where nothing is recorded."""
        return None if self.recordings is None else Past(self.recordings, f"{self.machine}-{self.axis}")

    @property
    def prefix(self) -> str:
        """The key prefix of everything published about the axis."""
        return f"ballscrew/{self.machine}/{self.axis}"


OUTLETS = ("page", "metrics", "mqtt", "opcua")


ReportState = Callable[[dict[str, Any]], None]
"""Takes the state of an outlet: a `reason`, or None with an `address` once it serves."""


_OUTPUT = threading.Lock()


def tell_service(document: dict[str, Any]) -> None:
    """Write a document to the service, a line of JSON: from an outlet, in whatever thread.

    An `outlet` reports its state: a `reason`, None with its `address` once it serves; or what is `unsent`.
    """
    with _OUTPUT:
        sys.stdout.write(json.dumps(document) + "\n")
        sys.stdout.flush()


async def run_together(*parts: Awaitable[None]) -> None:
    """Run the parts of an outlet until one of them ends; cancel the others, and raise its error."""
    tasks = [asyncio.ensure_future(part) for part in parts]
    try:
        ended, _ = await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
        for task in ended:
            task.result()
    finally:
        for task in tasks:
            task.cancel()
