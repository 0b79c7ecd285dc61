"""The page about Zenoh keys lists every key of the registry, when it is published and whether it answers."""

from __future__ import annotations

import re
from pathlib import Path

from observer.exchange import ESTIMATE_ENCODING, KEYS

PAGE = (Path(__file__).parents[2] / "docs" / "reference" / "zenoh.md").read_text(encoding="utf-8")
TABLE = re.findall(r"^\| `(\w+)` \| (.*) \| (.*?) \|$", PAGE, flags=re.M)


def test_every_published_key_has_its_line() -> None:
    published = {name: (holds, when) for name, holds, when in TABLE if not holds.startswith("queryable")}
    for name, key in KEYS.items():
        if key.when is not None:
            holds, when = published[name]
            assert when == key.when
            assert holds.startswith("CBOR" if key.encoding == ESTIMATE_ENCODING else "JSON")


def test_every_key_that_answers_has_its_line() -> None:
    assert {name for name, holds, _ in TABLE if holds.startswith("queryable")} == {
        name for name, key in KEYS.items() if key.answers
    }
