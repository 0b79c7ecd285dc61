"""An estimate as CBOR (see `observer.bus.codec.EstimateEncoder`), in one pass over its numbers."""

from __future__ import annotations

from observer.kernels.codes import PARTS
from observer.kernels.libc import bytes_of, float_at, octet_at, put_float32, put_float64


def put_piece(message, at, piece):
    """Write a constant piece of the message; return the position after it."""
    for i in range(message.ends[piece], message.ends[piece + 1]):
        message.out[at] = message.pieces[i]
        at += 1
    return at


def put_count(out, at, count):
    """Write a whole number ≥ 0 as CBOR; return the position after it."""
    size, mark = 0, count
    if count > 23:
        size, mark = 1, 24
        while size < 8 and count >> (8 * size) > 0:
            size, mark = 2 * size, mark + 1
    out[at] = mark
    for i in range(size):
        out[at + 1 + i] = (count >> (8 * (size - 1 - i))) & 255
    return at + 1 + size


def encode(message, data, sequence, sensors_used):
    """Return the message of an estimate, stored as `data`.

    The constant pieces are, in order:

    - the beginning, and the pieces between time, sequence, number of used sensors, and quality;
    - a name for each quality, and the key of each part's quality;
    - the head of each array, the head of the sensors' qualities, and a name for each of these.
    """
    source, arrays, first = data, len(message.begin), 4 + message.qualities + PARTS
    at = put_piece(message, 0, 0)
    put_float64(message.out, at, float_at(source, message.time_at))
    at = put_piece(message, at + 8, 1)
    at = put_count(message.out, at, sequence)
    at = put_piece(message, at, 2)
    at = put_count(message.out, at, sensors_used)
    at = put_piece(message, at, 3)
    at = put_piece(message, at, 4 + octet_at(source, message.quality_at))
    for part in range(PARTS):
        at = put_piece(message, at, 4 + message.qualities + part)
        at = put_piece(message, at, 4 + octet_at(source, message.parts_at + part))
    for a in range(arrays):
        at = put_piece(message, at, first + a)
        for i in range(message.numbers[a]):
            put_float32(message.out, at, float_at(source, message.begin[a] + 8 * i))
            at += 4
    at = put_piece(message, at, first + arrays)
    for i in range(message.sensors):
        at = put_piece(message, at, first + 1 + arrays + octet_at(source, message.sensors_at + i))
    return bytes_of(message.out, at)
