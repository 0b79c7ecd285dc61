"""The configuration's table of what is forecast of the next hour."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from observer.tables.quantities import Flag, Positive, Section


class ForecastSettings(Section):
    """What is forecast, and how often; `within_um` is how near to where it settles counts as settled.

    Without `enabled` it is on where every estimated heat has a law.
    """

    enabled: Flag | None = None
    hours: Annotated[Positive, Field(ge=0.05, le=24)] = 1.0
    within_um: Annotated[Positive, Field(ge=0.01, le=1000)] = 2.0
    period_s: Annotated[Positive, Field(ge=5, le=3600)] = 60.0
