"""An MTConnect agent, as found on many controls: data items by their id, requested each period over HTTP.

Channels are numbers. So an event whose value is a word becomes 1 where the word is the one in `equals`, else
0. EXECUTION is 1 while it is ACTIVE, and PROGRAM can be 1 while one program is loaded.
"""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, model_validator

from drivers.places import MtConnectChannel, check_channels
from drivers.polled import PolledTable
from drivers.protocol import ChannelName, PollPeriod, Text, Timeout


class MtConnectSettings(PolledTable):
    """An MTConnect agent; `device` is needed where it has several and an id is not unique."""

    session = "drivers.mtconnect_session"

    kind: Literal["mtconnect"]
    url: Annotated[Text, Field(pattern=r"^https?://[^/@\s?#]+(/[^\s?#]*)?$")]
    device: Annotated[str, Field(pattern=r"^[A-Za-z0-9_.-]+$", max_length=128)] | None = None
    period_s: PollPeriod = 0.5
    timeout_s: Timeout = 1.0
    channels: dict[ChannelName, MtConnectChannel] = Field(min_length=1)

    @model_validator(mode="after")
    def _each_its_own(self) -> MtConnectSettings:
        check_channels(self.channels)
        return self

    @property
    def address(self) -> str:
        """The URL below which the agent's documents are, with the device if one is given.

        It has no slash at its end; `/probe` and `/current` are appended.
        """
        return self.url.rstrip("/") + ("" if self.device is None else f"/{self.device}")
