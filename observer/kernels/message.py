"""An estimate as CBOR (see `observer.publish.codec.EstimateEncoder`), in one pass over its numbers."""

from __future__ import annotations

from observer.kernels.codes import PARTS
from observer.kernels.libc import bytes_of, float_at, octet_at, put_float32, put_float64


def put_piece(own, at, piece):
    """Write what is the same in every message; return where it ends."""
    for i in range(own.ends[piece], own.ends[piece + 1]):
        own.out[at] = own.pieces[i]
        at += 1
    return at


def put_count(out, at, count):
    """Write a whole number from 0 on as CBOR; return where it ends."""
    size, mark = 0, count
    if count > 23:
        size, mark = 1, 24
        while size < 8 and count >> (8 * size) > 0:
            size, mark = 2 * size, mark + 1
    out[at] = mark
    for i in range(size):
        out[at + 1 + i] = (count >> (8 * (size - 1 - i))) & 255
    return at + 1 + size


def encode(own, data, sequence, sensors_used):
    """Return the message of an estimate, kept as `data`.

    Pieces: the beginning, what is between time and sequence, between that and the number of sensors used,
    between that and quality, a name for each quality, the key of each part's quality, the head of each
    array, the head of the sensors' qualities, a name for each of these.
    """
    source, arrays, first = data, len(own.begin), 4 + own.qualities + PARTS
    at = put_piece(own, 0, 0)
    put_float64(own.out, at, float_at(source, own.time_at))
    at = put_piece(own, at + 8, 1)
    at = put_count(own.out, at, sequence)
    at = put_piece(own, at, 2)
    at = put_count(own.out, at, sensors_used)
    at = put_piece(own, at, 3)
    at = put_piece(own, at, 4 + octet_at(source, own.quality_at))
    for part in range(PARTS):
        at = put_piece(own, at, 4 + own.qualities + part)
        at = put_piece(own, at, 4 + octet_at(source, own.parts_at + part))
    for a in range(arrays):
        at = put_piece(own, at, first + a)
        for i in range(own.numbers[a]):
            put_float32(own.out, at, float_at(source, own.begin[a] + 8 * i))
            at += 4
    at = put_piece(own, at, first + arrays)
    for i in range(own.sensors):
        at = put_piece(own, at, first + 1 + arrays + octet_at(source, own.sensors_at + i))
    return bytes_of(own.out, at)
