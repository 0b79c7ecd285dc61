"""A whole search whose second effect proves nothing: on a rod that another code simulates."""

from __future__ import annotations

from pathlib import Path

import pytest

from observer.app import discover
from tests.truth.heated_rod import draw, write

pytestmark = pytest.mark.slow
SEED, HIDDEN = 9502, "block"


def test_what_was_named_without_proof_is_unknown_and_the_rest_is_offered(tmp_path: Path) -> None:
    """Only the heater's block is hidden. A heat somewhere on the rod takes up what the block's form leaves of
    the fitted part of the log; it was named with it, and does not change what is held back.
    """
    log = write(draw(SEED, HIDDEN), SEED, tmp_path)
    folder = tmp_path / "found"
    found, result = discover(tmp_path / "config.toml", [log], folder, lambda *_: None, report=False)
    assert [t.candidate.name for t in found.search.chosen] == ["attached_mass at left", "local_heat"]
    assert found.proof.unproved == ("local_heat",)
    assert (result["verdict"], result["effects"]) == ("unknown", [])
    assert result["reason"].startswith("local_heat would explain")
    assert result["partial"]["kind"] == "attached_mass"
    assert not (folder / "config.toml").exists()
