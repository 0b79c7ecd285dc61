"""The page about Zenoh keys has the rows of the registry; `make reference` writes them."""

from __future__ import annotations

from observer.bus.exchange import ESTIMATE_ENCODING, KEYS
from tests.docs.reference import REFERENCE, written


def test_the_page_is_as_the_registry_writes_it() -> None:
    page = (REFERENCE / "zenoh.md").read_text(encoding="utf-8")
    assert written("zenoh.md") == page, "run `make reference`"
    assert all(f"| `{name}` | {key.holds} |" in page for name, key in KEYS.items())


def test_what_a_key_holds_begins_with_its_encoding() -> None:
    for key in KEYS.values():
        assert key.holds.startswith("CBOR" if key.encoding == ESTIMATE_ENCODING else "JSON")
