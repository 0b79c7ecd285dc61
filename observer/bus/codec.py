"""The content of messages: an estimate as CBOR for programs and as JSON for people.

CBOR carries everything a step returns; its arrays are float32, typed by RFC 8746 (tag 85, little-endian).
JSON has no NaN, so a value that is not known is null.
"""

from __future__ import annotations

import io
import json
import math
import re
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import cbor2
import numpy as np
from numpy.typing import NDArray

from observer.frames import (
    FORCE,
    PARTS,
    EstimateBlock,
    EstimateQuality,
    FloatArray,
    FrameBlock,
    Layout,
    Quality,
)
from observer.kernels import encode, record
from observer.kernels.layout import Bundle, Fields

if TYPE_CHECKING:
    from observer.config.machine import Config

_FLOAT32_LE = 85
_SHORT_MAP = 24
"""A CBOR map with fewer entries has their number in its first byte."""
_DIGITS = 6
_QUALITY = [quality.label for quality in EstimateQuality]
_CHANNEL_QUALITY = [quality.label for quality in Quality]
_FLOAT64_MARK = b"\xfb"
_ACCESS: Any = {
    "publish": {"tls", "login", "access"}, "page": True, "metrics": True, "mqtt": True, "opcua": True,
    "outlets": {"also"},
}  # fmt: skip
_JSON = json.JSONEncoder(allow_nan=False, separators=(",", ":"))
_ARRAYS = (
    "heat_W", "heat_sigma_W", "heat_bound_W", "law_W", "field_degC", "field_sigma_K", "field_bound_K",
    "error_um", "error_sigma_um", "error_bound_um", "innovation_K", "innovation_sigma_K",
)  # fmt: skip
_ENTRIES = len(_ARRAYS) + len(PARTS) + 9
"""Entries of the map, without those that only some machines have."""


class Message(NamedTuple):
    """The arguments of the kernel that makes one message (see `kernels.message.encode`).

    Attributes:
        out: Where it writes.
        pieces: The bytes that are the same in all messages.
        ends: The ends of the pieces, the first of them 0.
        begin: Where each array begins in an estimate's memory, in bytes.
        numbers: How many numbers each array has.
        qualities: How many words of quality there are.
        sensors: How many sensors.
        time_at: Where the time stands in an estimate's memory.
        quality_at: Where the quality stands.
        parts_at: Where the qualities of heat, field and error stand.
        sensors_at: Where the sensors' qualities stand.
    """

    out: NDArray[np.uint8]
    pieces: NDArray[np.uint8]
    ends: NDArray[np.int64]
    begin: NDArray[np.int64]
    numbers: NDArray[np.int64]
    qualities: int
    sensors: int
    time_at: int
    quality_at: int
    parts_at: int
    sensors_at: int


def _fields_of(block: EstimateBlock, k: int) -> tuple[Fields, bytes]:
    """One step of a block in one piece."""
    names = (*_ARRAYS, *FORCE, "time_s", "quality", "part_quality", "sensor_quality")
    bundle = Bundle.of({name: np.asarray(getattr(block, name)[k]) for name in names})
    return bundle.fields, bundle.octets.tobytes()


def _typed(array: FloatArray) -> cbor2.CBORTag:
    return cbor2.CBORTag(_FLOAT32_LE, array.astype("<f4").tobytes())


def _pair(key: str, value: Any) -> bytes:
    """An entry of a map."""
    return cbor2.dumps(key) + cbor2.dumps(value)


def _head(key: str, size: int) -> bytes:
    """The beginning of an entry that is a typed array of so many bytes, which follow."""
    whole = _pair(key, cbor2.CBORTag(_FLOAT32_LE, bytes(size)))
    return whole[: len(whole) - size]


def _array_head(count: int) -> bytes:
    """The beginning of an array of so many items, which follow."""
    return cbor2.dumps([None] * count)[: -count or None]


def _map_head(count: int) -> bytes:
    """The beginning of a map of so many entries, which follow: up to 255."""
    return bytes((0xA0 + count,)) if count < _SHORT_MAP else bytes((0xB8, count))


class EstimateEncoder:
    """Encodes single estimates of one layout and one `instance`.

    In all methods `block` holds estimates, `k` is the step in it, and `sequence` the step's number. Numbers
    in JSON have six decimals, and one that is not finite is null.

    The constant parts are encoded once, and the numbers are written between them: only one thread at a time
    may encode.

    Args:
        layout: Names and places of the outputs.
        instance: Names the start of the service, in every message.

    Attributes:
        documents: The method that makes each document of a step beside the estimate, by key.
    """

    def __init__(self, layout: Layout, instance: str) -> None:
        self._instance = instance
        self._sources, sensors = list(layout.sources), list(layout.sensors)
        self._position_m = _rounded(layout.position_m)
        self._learned = list(layout.learned)
        m, g, s = len(self._sources), len(layout.position_m), len(sensors)
        error = g if layout.has_error else 0
        moved = _pair("displacements", list(layout.displacements)) if layout.displacements else b""
        before = {
            "heat_W": _pair("sources", self._sources),
            "field_degC": _pair("position_m", _typed(layout.position_m)),
            "innovation_K": _pair("sensors", sensors) + moved,
        }
        self._widths = dict(zip(_ARRAYS, (m, m, m, m, g, g, g, error, error, error, s, s), strict=True))
        self._force = FORCE if layout.has_force else ()
        self._widths |= dict.fromkeys(self._force, 1)
        self._pieces = [
            _map_head(_ENTRIES + len(moved[:1]) + len(self._force)) + cbor2.dumps("time_s") + _FLOAT64_MARK,
            cbor2.dumps("sequence"),
            cbor2.dumps("sensors_used"),
            _pair("instance", instance) + cbor2.dumps("quality"),
            *map(cbor2.dumps, _QUALITY),
            *(cbor2.dumps(f"{part}_quality") for part in PARTS),
            *(before.get(name, b"") + _head(name, 4 * n) for name, n in self._widths.items()),
            cbor2.dumps("sensor_quality") + _array_head(s),
            *map(cbor2.dumps, _CHANNEL_QUALITY),
        ]
        self._sensors = s
        self.documents = {
            "heat": self.heat,
            "field": self.field,
            "error": self.error,
            "learned": self.learned,
        }
        """The documents of each step beside the estimate itself, by key."""
        self._fields: Any = None  # of the last estimate, and how the kernel makes a message of it
        self._message: Any = None

    def cbor(self, block: EstimateBlock, k: int, sequence: int) -> bytes:
        """Return everything a step gives, as CBOR.

        `decode_estimate` is its inverse up to float32. Blocks of another memory layout are accepted, but cost
        more at their first message.
        """
        try:
            fields, data = block.kept
        except AttributeError:
            fields, data = _fields_of(block, k)
        if fields is not self._fields:
            self._fields, self._message = fields, record(self._message_of(fields.dtype.fields))
        message: bytes = encode(self._message, data, sequence, int(block.sensors_used[k]))
        return message

    def _message_of(self, fields: Any) -> Message:
        """How a message is made of an estimate with these fields in memory."""
        sizes = [len(piece) for piece in self._pieces]
        room = sum(sizes) + 32 * (3 + len(PARTS) + self._sensors) + 4 * sum(self._widths.values())
        return Message(
            np.zeros(room, np.uint8),
            np.frombuffer(b"".join(self._pieces), np.uint8).copy(),
            np.cumsum([0, *sizes]),
            np.array([fields[name][1] for name in self._widths]),
            np.array(list(self._widths.values())),
            len(_QUALITY),
            self._sensors,
            *(fields[name][1] for name in ("time_s", "quality", "part_quality", "sensor_quality")),
        )

    def heat(self, block: EstimateBlock, k: int, sequence: int) -> bytes:
        """Return the `heat` document: heat, σ and bound of each source, in W."""
        columns = block.heat_W[k], block.heat_sigma_W[k], block.heat_bound_W[k]
        sources = [
            {"heat_W": heat_W, "sigma_W": sigma_W, "bound_W": bound_W}
            for heat_W, sigma_W, bound_W in zip(*map(_rounded, columns), strict=True)
        ]
        body = {"sources": dict(zip(self._sources, sources, strict=True))}
        return self._json(block, k, sequence, body, "heat")

    def field(self, block: EstimateBlock, k: int, sequence: int) -> bytes:
        """Return the `field` document: temperature in °C, σ and bound in K, at positions in m."""
        arrays = (block.field_degC, block.field_sigma_K, block.field_bound_K)
        names = ("temperature_degC", "sigma_K", "bound_K")
        return self._json(block, k, sequence, self._curve(k, names, arrays), "field")

    def error(self, block: EstimateBlock, k: int, sequence: int) -> bytes:
        """Return the `error` document: thermal error, σ and bound in µm, at positions in m.

        A screw that is held at both ends also has its axial force in N. Without an expansion coefficient the
        arrays are empty.
        """
        arrays = (block.error_um, block.error_sigma_um, block.error_bound_um)
        body = self._curve(k, ("error_um", "sigma_um", "bound_um"), arrays)
        body |= {name: _rounded(getattr(block, name)[k])[0] for name in self._force}
        return self._json(block, k, sequence, body, "error")

    def _curve(self, k: int, names: Sequence[str], arrays: Sequence[FloatArray]) -> dict[str, Any]:
        body = {name: _rounded(array[k]) for name, array in zip(names, arrays, strict=True)}
        return {"position_m": self._position_m, **body}

    def learned(self, block: EstimateBlock, k: int, sequence: int) -> bytes:
        """Return the `learned` document: value and σ of each learnt parameter, in the unit of its name."""
        pairs = zip(_rounded(block.learned[k]), _rounded(block.learned_sigma[k]), strict=True)
        learned = [{"value": value, "sigma": sigma} for value, sigma in pairs]
        return self._json(block, k, sequence, {"parameters": dict(zip(self._learned, learned, strict=True))})

    def readings(self, frame: FrameBlock, k: int, sequence: int) -> bytes:
        """Return the `readings` document: value, quality and age in s of every channel.

        Args:
            frame: The frame behind the estimate.
            k: The step in it.
            sequence: The estimate's number.
        """
        columns = _rounded(frame.values[k]), frame.shown_quality[k].tolist(), _rounded(frame.age_s[k])
        channels = {
            name: {"value": value, "quality": _CHANNEL_QUALITY[quality], "age_s": age_s}
            for name, value, quality, age_s in zip(frame.channels, *columns, strict=True)
        }
        head = {"time_s": float(frame.time_s[k]), "sequence": sequence, "instance": self._instance}
        return to_json({**head, "channels": channels})

    def _json(
        self, block: EstimateBlock, k: int, sequence: int, body: dict[str, Any], part: str = ""
    ) -> bytes:
        quality = _QUALITY[block.part_quality[k, PARTS.index(part)] if part else block.quality[k]]
        head = {"time_s": float(block.time_s[k]), "sequence": sequence, "instance": self._instance}
        return to_json({**head, **self.counts(block, k), **body, "quality": quality})

    def counts(self, block: EstimateBlock, k: int) -> dict[str, int]:
        """The number of sensors that an estimate uses, and of all that are configured."""
        return {"sensors_used": int(block.sensors_used[k]), "sensors": self._sensors}


def _rounded(array: FloatArray) -> list[float | None]:
    numbers: list[float | None] = np.round(array, _DIGITS).tolist()
    if np.isfinite(array).all():
        return numbers
    return [x if x is not None and math.isfinite(x) else None for x in numbers]


def to_json(document: Any) -> bytes:
    """Return a document as compact JSON in UTF-8.

    Raises:
        ValueError: If it holds NaN or an infinity, which JSON does not have.
        TypeError: If it holds an object that is not plain data.
    """
    return _JSON.encode(document).encode()


def config_json(config: Config, instance: str) -> str:
    """Return the configuration in force and its hash, as the `config` queryable answers.

    Credentials and their files are left out: every reader can see the answer.

    Args:
        config: The configuration in force.
        instance: Names the start of the service.
    """
    public = config.model_dump(mode="json", by_alias=True, exclude=_ACCESS)
    return json.dumps({"hash": config.digest, "instance": instance, "config": public})


_INSTANCE = re.compile(rb'instance(?:": ?"|h)([0-9a-f]{8})')
"""An instance within JSON, or as a text of eight within CBOR; no forged message is parsed for it."""


def array_of(messages: Sequence[bytes]) -> bytes:
    """Return encoded estimates as one CBOR array, without decoding them."""
    return _array_head(len(messages)) + b"".join(messages)


def late(message: bytes) -> bytes:
    """Return an encoded estimate with the entry `late`, which marks it as sent after its time."""
    short = message[0] < _map_head(_SHORT_MAP)[0]
    count, body = (message[0] - 0xA0, message[1:]) if short else (message[1], message[2:])
    return _map_head(count + 1) + body + _pair("late", True)


def late_json(document: bytes) -> bytes:
    """Return a JSON object with the entry `late`, which marks it as sent after its time."""
    return document[:-1] + b',"late":true}'


def instance_of(message: bytes) -> str | None:
    """Return the start of the service that a message names, None without; the message is not decoded."""
    match = _INSTANCE.search(message)
    return None if match is None else match[1].decode()


def decode_estimate(data: bytes) -> dict[str, Any]:
    """Return an estimate from its CBOR; typed arrays become float32 arrays.

    The bytes may come from anybody. The entries `time_s` and `sequence` are present, but their types are not
    checked.

    Raises:
        ValueError: If the bytes are not exactly one estimate.
    """
    estimate = decode(data)
    if not isinstance(estimate, dict) or "time_s" not in estimate or "sequence" not in estimate:
        raise ValueError("not an estimate: a map with time_s and sequence is expected")
    return estimate


def decode(data: bytes) -> Any:
    """Decode CBOR: an estimate, a list or a page of them.

    Raises:
        ValueError: If the bytes are not exactly one item, or hold an array of another type than float32.
    """
    stream = io.BytesIO(data)
    try:
        message = cbor2.load(stream, tag_hook=_array)
    except (cbor2.CBORDecodeError, UnicodeDecodeError) as error:
        raise ValueError(f"cannot be decoded as CBOR: {error.__cause__ or error}") from None
    if stream.tell() != len(data):
        raise ValueError(f"{len(data) - stream.tell()} bytes follow the message")
    return message


def _array(tag: cbor2.CBORTag, *_: Any) -> NDArray[np.float32]:
    if tag.tag != _FLOAT32_LE or not isinstance(tag.value, bytes) or len(tag.value) % 4:
        raise ValueError(f"not a float32 array: CBOR tag {tag.tag}")
    return np.frombuffer(tag.value, "<f4")
