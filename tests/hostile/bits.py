"""Files with some of their bytes changed, cut, doubled or lost, by a seed."""

from __future__ import annotations

import random
from collections.abc import Iterator


def damaged(data: bytes, count: int, seed: int) -> Iterator[tuple[str, bytes]]:
    """Draw so many damaged copies, each with what was done to it."""
    rng = random.Random(seed)
    for _ in range(count):
        i, j = sorted(rng.randrange(len(data) + 1) for _ in range(2))
        some = rng.randbytes(rng.choice((1, 2, 8)))
        ways = {
            "cut": data[:i],
            "begun late": data[i:],
            "a piece gone": data[:i] + data[j:],
            "a piece twice": data[:j] + data[i:],
            "other bytes": data[:i] + some + data[i + len(some) :],
            "more bytes": data[:i] + some + data[i:],
            "zeros": data[:i] + bytes(j - i) + data[j:],
            "digits": data[:i] + b"9" * 400 + data[i:],
            "a line break": data[:i] + b"\n" + data[i:],
            "a quote": data[:i] + b'"' + data[i:],
        }
        way = rng.choice(sorted(ways))
        yield f"{way} at {i} to {j} of {len(data)}", ways[way]
