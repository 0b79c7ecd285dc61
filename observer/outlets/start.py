"""What the process of the outlets is to serve, and the states of its outlets."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable
from pathlib import Path
from typing import TYPE_CHECKING

import structlog
from pydantic import BaseModel, ConfigDict, FiniteFloat, TypeAdapter

from observer.config.outlets import Metrics, Mqtt, Opcua, OutsideOutlet, Page
from observer.config.publishing import DEFAULT_ENDPOINT, Client
from observer.record.step_store import Past

if TYPE_CHECKING:
    from observer.installation import Installation

OUTLETS = ("page", "metrics", "mqtt", "opcua")

log = structlog.get_logger()


class Start(BaseModel):
    """The outlets to serve, with their settings, and the bus that they are clients of.

    `connect` is the Zenoh endpoint, `client` the login there. `recordings` is the folder of the recordings;
    `laws` are the sources with a heat law; `forecast_s` is the interval of forecasts, None without. `also`
    has the outlets of other packages by the name of their table.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    machine: str
    axis: str
    period_s: float
    connect: str = DEFAULT_ENDPOINT
    client: Client | None = None
    page: Page | None = None
    metrics: Metrics | None = None
    mqtt: Mqtt | None = None
    opcua: Opcua | None = None
    also: dict[str, OutsideOutlet] = {}
    recordings: Path | None = None
    laws: tuple[str, ...] = ()
    forecast_s: float | None = None

    @classmethod
    def of(cls, config: Installation, connect: str = "", client: Client | None = None) -> Start | None:
        """Return the start of a configuration's outlets, None without any.

        Without `connect` they go where the configured service listens, else to its router.
        """
        outlets = {name: getattr(config, name) for name in OUTLETS}
        also = {f"outlets.also.{name}": outlet for name, outlet in config.outlets.also.items()}
        if not also and all(outlet is None for outlet in outlets.values()):
            return None
        forecasts = config.forecast.enabled
        if forecasts is None:
            forecasts = all(source.law is not None for source in config.source if source.estimate)
        return cls(
            machine=config.machine.name,
            axis=config.machine.axis,
            period_s=config.estimator.period_s,
            connect=connect or config.publish.reached_at,
            client=client,
            recordings=None if (folder := config.record.directory) is None else folder.absolute(),
            laws=tuple(source.name for source in config.source if source.law is not None),
            forecast_s=config.forecast.period_s if forecasts else None,
            also=also,
            **outlets,
        )

    @property
    def names(self) -> tuple[str, ...]:
        """The names of the outlets to serve."""
        return (*(name for name in OUTLETS if getattr(self, name) is not None), *self.also)

    @property
    def past(self) -> Past | None:
        """The published steps of the axis, None where nothing is recorded."""
        return None if self.recordings is None else Past(self.recordings, f"{self.machine}-{self.axis}")

    @property
    def prefix(self) -> str:
        """The key prefix of everything published about the axis."""
        return f"ballscrew/{self.machine}/{self.axis}"


class OutletState(BaseModel):
    """The state of an outlet: `reason` says why it does not serve, None where it serves at `address`.

    `doubt` is a sentence about how it serves. `unsent` is what it has still to send late: the number of
    `steps`, and the `duration_s` they span.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    reason: str | None = None
    address: str | None = None
    doubt: str | None = None
    unsent: dict[str, FiniteFloat] | None = None

    def log_change(self, name: str, before: OutletState | None) -> None:
        """Log where the outlet serves now, if that is new."""
        if self.reason is None and (before is None or before.reason is not None):
            log.info("outlet", name=name, address=self.address)
            if self.doubt is not None:
                log.warning("outlet", name=name, doubt=self.doubt)


STATES = TypeAdapter(dict[str, OutletState])
"""The states of all outlets by name, as their process publishes them on the key `outlets`."""


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
