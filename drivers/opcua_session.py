"""The one file that knows asyncua: one session with one OPC UA server, reads only."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import re
from collections.abc import Mapping
from datetime import UTC, datetime
from math import isfinite, nan

from asyncua import ua
from asyncua.client.client import Client
from asyncua.crypto import security_policies
from asyncua.ua.attribute_ids import AttributeIds
from asyncua.ua.uaerrors import UaError

from drivers.places import OpcUaChannel, OpcUaServer
from drivers.polled import Answer, LostError

# Everything asyncua logs is also told by its exceptions, and then counted in the driver's status.
logging.getLogger("asyncua").setLevel(logging.CRITICAL)

_GOOD_BYE_S = 0.2
_LIMITS = {0x0500: "under_range", 0x0600: "over_range"}  # bits 8 to 11: at its low, high limit (part 4, 7.39)
_NEVER = datetime(1980, 1, 1, tzinfo=UTC)  # servers without a clock give 1601, 1970 or none


async def connect(server: OpcUaServer) -> OpcUaSession:
    """Connect once. Raises `LostError`."""
    client = Client(server.url, timeout=server.timeout_s, watchdog_intervall=3600.0)
    try:
        async with asyncio.timeout(server.timeout_s):
            await _secure(client, server)
            await client.connect()
    except TimeoutError:
        await _end(client)
        raise LostError("disconnected", f"{server.url} does not answer") from None
    except (OSError, ValueError, UaError) as error:
        await _end(client)
        raise LostError("disconnected", f"{server.url}: {_told(error)}") from None
    except asyncio.CancelledError:
        await _end(client)
        raise
    return OpcUaSession(client, server)


async def _secure(client: Client, server: OpcUaServer) -> None:
    if server.certificate is not None:
        policy = getattr(security_policies, f"SecurityPolicy{server.policy}")
        await client.set_security(
            policy,
            str(server.certificate),
            str(server.private_key),
            server_certificate=str(server.server_certificate),
        )
    if server.user is not None and server.password_file is not None:
        client.set_user(server.user)
        client.set_password(server.password_file.read_text(encoding="utf-8").strip())


class OpcUaSession:
    """A session that is open."""

    def __init__(self, client: Client, server: OpcUaServer) -> None:
        self.problem: str | None = None
        self._client = client
        self._server = server
        self._nodes = [client.get_node(place.node) for place in server.channels.values()]

    async def ask(self) -> Mapping[str, Answer]:
        """Read every node in one request. Raises `LostError`."""
        url = self._server.url
        try:
            async with asyncio.timeout(self._server.timeout_s):
                found = await self._client.read_attributes(self._nodes, AttributeIds.Value)
        except TimeoutError:
            raise LostError("timeout", f"{url} does not answer in time") from None
        except (OSError, ValueError, UaError) as error:
            raise LostError("disconnected", f"{url}: {_told(error)}") from None
        if len(found) != len(self._nodes):
            raise LostError("bad_reply", f"{url}: asked for {len(self._nodes)} values, got {len(found)}")
        self.problem = None
        return {
            channel: self._answer(channel, place, data)
            for (channel, place), data in zip(self._server.channels.items(), found, strict=True)
        }

    async def close(self) -> None:
        """End the session."""
        await _end(self._client)

    def _answer(self, channel: str, place: OpcUaChannel, data: ua.DataValue) -> Answer:
        stamp_s = _seconds(data.SourceTimestamp)
        if data.StatusCode is not None and (fault := _fault(data.StatusCode)) is not None:
            if fault.startswith("bad_node"):
                self.problem = f"channel {channel}: the server has no node {place.node}; mend its node"
            return Answer(fault=fault, stamp_s=stamp_s)
        number = None if data.Value is None else data.Value.Value
        if isinstance(number, bool | int | float):
            value = place.scale * float(number) + place.offset
            return Answer(value, stamp_s=stamp_s) if isfinite(value) else Answer(fault="not_finite")
        kind = "nothing" if number is None else type(number).__name__
        self.problem = f"channel {channel}: {place.node} holds {kind}, not a number; name another node"
        return Answer(fault="wrong_type", stamp_s=stamp_s)


def _fault(status: ua.StatusCode) -> str | None:
    """The name of a status that is not plainly good, as a fault: BadSensorFailure is bad_sensor_failure."""
    if status.value & 0xFFFF0000 == 0:
        return _LIMITS.get(status.value & 0x0F00)
    return re.sub(r"(?<=[a-z0-9])(?=[A-Z])", "_", status.name).lower()[:64]


def _seconds(stamp: datetime | None) -> float:
    """A time as seconds since the epoch, NaN where it is none."""
    if stamp is None:
        return nan
    stamp = stamp if stamp.tzinfo is not None else stamp.replace(tzinfo=UTC)
    return stamp.timestamp() if stamp > _NEVER else nan


async def _end(client: Client) -> None:
    """Say good-bye, to a server that may not be there any more."""
    with contextlib.suppress(Exception):  # whatever it says, the socket is closed next
        await asyncio.wait_for(client.disconnect(), _GOOD_BYE_S)
    with contextlib.suppress(Exception):
        client.disconnect_socket()


def _told(error: Exception) -> str:
    return str(error) or type(error).__name__
