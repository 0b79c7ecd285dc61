"""The one file that queries an MTConnect agent: its documents over HTTP, and their content (ANSI/MTC1.4).

An answer may be anything. It is read up to a limit of size and time, without document types and entities,
and counts only if it is a document of the standard.
"""

from __future__ import annotations

import asyncio
import logging
import re
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import datetime
from math import isfinite, nan
from xml.etree.ElementTree import Element, ParseError

import httpx
from defusedxml.common import DefusedXmlException
from defusedxml.ElementTree import fromstring

from drivers.connecting import why_not_opened
from drivers.mtconnect import MtConnectSettings
from drivers.places import MtConnectChannel
from drivers.polled import LostError, PolledValue, SourceTimes
from drivers.protocol import Clock
from observer.frames import Reading
from observer.units import spelled

logging.getLogger("httpx").setLevel(logging.WARNING)  # it reports every request otherwise

LARGEST_BYTES = 2_000_000  # a probe of a large machining centre has some 200 kB
_ROOT = re.compile(r"\{urn:mtconnect\.org:MTConnect(Devices|Streams|Error):[12]\.\d+\}MTConnect\1")
_NUMBER = re.compile(r"[+-]?(\d{1,40}\.?\d{0,40}|\.\d{1,40})([eE][+-]?\d{1,3})?", re.ASCII)
_UNAVAILABLE = "UNAVAILABLE"
_CLOCK_STEP_S = 1.0  # many agents give the time of a document in whole seconds
_UNCHANGED = ("", "COUNT", "DEGREE", "HERTZ")
"""Units of the standard (part 2, 7.2.2.5) whose values are taken as they are; others are looked up."""


@dataclass(frozen=True, slots=True)
class _Item:
    """How a data item becomes a number: by the factor of its unit, or as 1 where it equals a word."""

    factor: float
    equals: str | None


async def connect(agent: MtConnectSettings, now: Clock) -> MtConnectSession:
    """Connect, and read the agent's list of data items once.

    Proxies of the environment are ignored, and redirections are not followed.

    Args:
        agent: The agent and its channels.
        now: The service's clock in s.

    Raises:
        LostError: If the agent cannot be reached, or its answer is not a list of data items.
    """
    client = httpx.AsyncClient(
        timeout=agent.timeout_s,
        follow_redirects=False,
        trust_env=False,
        headers={"Accept": "text/xml", "Accept-Encoding": "identity"},
    )
    session = MtConnectSession(client, agent, now)
    try:
        await session.probe()
    except BaseException:
        await session.close()
        raise
    return session


class MtConnectSession:
    """A connection to an agent, with the description of its data items.

    Attributes:
        problem: A sentence about the first channel whose data item is missing, ambiguous, or not a number in
            a known unit; None if all are usable. Such a channel has the fault `unknown_item`.
    """

    def __init__(self, client: httpx.AsyncClient, agent: MtConnectSettings, now: Clock) -> None:
        self.problem: str | None = None
        self._client = client
        self._agent = agent
        self._now = now
        self._times = SourceTimes()
        self._url = agent.address
        self._instance: str | None = None
        self._items: dict[str, _Item | str] = {}
        self._made_s = nan
        self._fresh_s = 0.0

    async def probe(self) -> None:
        """Look up the data item of every channel, and set `problem`.

        Raises:
            LostError: If the agent does not answer, or its answer is not a list of data items.
        """
        root = await self._get("probe", "Devices")
        self._instance = _header(root).get("instanceId")
        elements_by_id: dict[str, list[Element]] = {}
        for element in root.iter():
            if _name(element) == "DataItem":
                elements_by_id.setdefault(element.get("id", ""), []).append(element)
        for channel, place in self._agent.channels.items():
            self._items[channel] = _item(place, elements_by_id.get(place.item, []))
        wrong = {channel: item for channel, item in self._items.items() if isinstance(item, str)}
        problems = [f"channel {channel}: {item}" for channel, item in wrong.items()]
        self.problem = problems[0] if problems else None

    async def ask(self) -> list[Reading]:
        """Return the current value of every channel, one reading for each source time, oldest first.

        Values are in SI units or °C by the unit of the data item. Faults are `unknown_item`, `missing`,
        `ambiguous`, `unavailable`, `wrong_type` and `not_finite`.

        Raises:
            LostError: If the agent does not answer in time, has restarted, or sends an old or invalid
                document. The fault is `timeout`, `disconnected`, `restarted`, `stale` or `bad_reply`.
        """
        root = await self._get("current", "Streams")
        header = _header(root)
        if header.get("instanceId") != self._instance:
            raise LostError("restarted", f"{self._url}: the agent has restarted; its items are read again")
        self._refuse_old(_seconds(header.get("creationTime")))
        item_ids = {place.item for place in self._agent.channels.values()}
        elements_by_id: dict[str, list[Element]] = {}
        for element in root.iter():
            if (key := element.get("dataItemId")) in item_ids:
                elements_by_id.setdefault(str(key), []).append(element)
        answers = {
            channel: _answer(self._items[channel], place, elements_by_id.get(place.item, []))
            for channel, place in self._agent.channels.items()
        }
        return self._times.readings(answers, self._now())

    async def close(self) -> None:
        """End the connection."""
        await self._client.aclose()

    def _refuse_old(self, made_s: float) -> None:
        """Raise `LostError` for a document from a cache, whose creation time does not advance."""
        now_s = asyncio.get_running_loop().time()
        if made_s != self._made_s:
            if made_s < self._made_s - _CLOCK_STEP_S:
                raise LostError(
                    "stale",
                    f"{self._url}: the answer is older than the one before; give the agent's own address",
                )
            self._made_s, self._fresh_s = made_s, now_s
        elif now_s - self._fresh_s > self._agent.timeout_s + _CLOCK_STEP_S:
            raise LostError(
                "stale",
                f"{self._url}: the same answer comes again, as from a cache; give the agent's own address",
            )

    async def _get(self, request: str, kind: str) -> Element:
        """Fetch a document and return its root; `request` is “probe” or “current”. Raises `LostError`."""
        url = f"{self._url}/{request}"
        try:
            async with asyncio.timeout(
                self._agent.timeout_s
            ):  # the whole document, however slowly it arrives
                data = await self._body(url)
        except TimeoutError:
            raise LostError(
                "timeout", f"{url} does not answer in time; check the agent, or raise timeout_s"
            ) from None
        except httpx.TimeoutException:
            raise LostError(
                "timeout", f"{url} does not answer in time; check the agent, or raise timeout_s"
            ) from None
        except httpx.ConnectError as error:
            raise LostError("disconnected", why_not_opened(error, self._url)) from None
        except (httpx.HTTPError, httpx.InvalidURL, OSError, ValueError) as error:
            raise LostError("disconnected", f"{url}: {error or type(error).__name__}") from None
        return document(data, kind, url)

    async def _body(self, url: str) -> bytes:
        """Return the bytes of a document. Raises `LostError` for an HTTP error or more than
        `LARGEST_BYTES`.
        """
        data = bytearray()
        async with self._client.stream("GET", url) as response:
            if response.status_code >= 500 or response.status_code in {301, 302, 303, 307, 308}:
                raise LostError("bad_reply", f"{url} answers with HTTP {response.status_code}; correct url")
            async for part in response.aiter_raw():
                data += part
                if len(data) > LARGEST_BYTES:
                    raise LostError(
                        "bad_reply", f"{url} sends more than {LARGEST_BYTES} bytes; name the device"
                    )
            if response.status_code != 200 and not data.lstrip().startswith(b"<?xml"):
                raise LostError("bad_reply", f"{url} answers with HTTP {response.status_code}; correct url")
        return bytes(data)


def document(data: bytes, kind: str, url: str) -> Element:
    """Return the root of a document of a kind.

    Document types and entities are rejected, because an answer may come from anywhere.

    Args:
        data: The body of the answer.
        kind: `"Devices"` or `"Streams"`.
        url: The address, for messages.

    Raises:
        LostError: If it is not XML, or not such a document of version 1 or 2. If the agent reports an error,
            its text is quoted.
    """
    try:
        root: Element = fromstring(data, forbid_dtd=True)
    except (ParseError, DefusedXmlException, ValueError, LookupError) as error:
        reason = re.sub(r"\s+", " ", str(error))[:120]
        raise LostError("bad_reply", f"{url} is no XML that can be trusted ({reason}); correct url") from None
    root_match = _ROOT.fullmatch(root.tag)
    if root_match is not None and root_match[1] == "Error":
        text = next((" ".join((e.text or "").split())[:120] for e in root.iter() if _name(e) == "Error"), "")
        raise LostError("bad_reply", f"{url}: the agent refuses: {text}; correct url and device")
    if root_match is None or root_match[1] != kind:
        raise LostError(
            "bad_reply",
            f"{url} is {root.tag[:80]}, no MTConnect{kind} document of version 1 or 2; correct url",
        )
    return root


def _item(place: MtConnectChannel, elements: list[Element]) -> _Item | str:
    """Return a channel's item as described by the probe, or a sentence why it is not available."""
    if not elements:
        return f"the agent has no data item {place.item}; fix its item"
    if len(elements) > 1:
        return f"the agent has {len(elements)} data items {place.item}; name the device"
    item = elements[0]
    if item.get("category") == "CONDITION":
        return f"{place.item} is a condition, which is not a number; name a sample or an event"
    equals = place.equals or ("ACTIVE" if item.get("type") == "EXECUTION" else None)
    units = item.get("units", "")
    unit = spelled(units)
    if equals is not None or units in _UNCHANGED:
        return _Item(1.0, equals)
    if unit is None or not unit.base or unit.shift:
        return f"{place.item} is in {units[:40]}, which is not known here; name another item"
    return _Item(unit.size, None)


def _answer(item: _Item | str, place: MtConnectChannel, elements: list[Element]) -> PolledValue:
    """Return the current value of an item, or its fault, with the item's own time."""
    if isinstance(item, str):
        return PolledValue(fault="unknown_item")
    if len(elements) != 1:
        return PolledValue(fault="ambiguous" if elements else "missing")
    text, stamp_s = (elements[0].text or "").strip(), _seconds(elements[0].get("timestamp"))
    if text == _UNAVAILABLE or len(elements[0]):
        return PolledValue(fault="unavailable" if text == _UNAVAILABLE else "wrong_type", stamp_s=stamp_s)
    if item.equals is not None:
        return PolledValue(place.value(float(text == item.equals)), stamp_s=stamp_s)
    if not _NUMBER.fullmatch(text):
        return PolledValue(fault="wrong_type", stamp_s=stamp_s)
    value = place.value(item.factor * float(text))
    return PolledValue(value, stamp_s=stamp_s) if isfinite(value) else PolledValue(fault="not_finite")


def _header(root: Element) -> Mapping[str, str]:
    return next((element.attrib for element in root if _name(element) == "Header"), {})


def _name(element: Element) -> str:
    return element.tag.rpartition("}")[2]


def _seconds(text: str | None) -> float:
    """Return a time of the standard (ISO 8601, UTC) in s since 1970; NaN for any other text."""
    try:
        stamp = datetime.fromisoformat((text or "")[:40])
    except ValueError:
        return nan
    return stamp.timestamp() if stamp.tzinfo is not None else nan
