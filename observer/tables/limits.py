"""What a channel may say before it is refused: the `[limits]` of a configuration."""

from __future__ import annotations

from pydantic import model_validator

from observer.tables.quantities import Finite, Positive, Section


class ChannelLimits(Section):
    """Limits of one channel, in its own unit; what is not given has a default by the kind of channel.

    `rate_per_s` is the fastest change; `above_ambient_K`, `below_ambient_K` how far a thermocouple on the
    screw may be from the air.
    """

    low: Finite | None = None
    high: Finite | None = None
    rate_per_s: Positive | None = None
    above_ambient_K: Positive | None = None
    below_ambient_K: Positive | None = None

    @model_validator(mode="after")
    def _something_passes(self) -> ChannelLimits:
        if self.low is not None and self.high is not None and not self.low < self.high:
            raise ValueError(f"low = {self.low} must be smaller than high = {self.high}")
        return self
