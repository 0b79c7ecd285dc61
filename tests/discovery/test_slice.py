"""A slice of the campaign: one case of every sort, searched in earnest through the public face.

Twelve cases of some 30 s of one core each, so three minutes on two.
"""

from __future__ import annotations

from pathlib import Path

import pytest

from campaigns.discovery.judge import SCALES
from campaigns.discovery.trial import try_entry
from tests.truth.machine.entries import Entry, rough_slice, slice_entries

FAR = 0.2
"""Relative error of a strong effect's parameter that would be a mistake, not chance."""


@pytest.mark.slow
@pytest.mark.nightly
@pytest.mark.parametrize("entry", [*slice_entries(), *rough_slice()], ids=lambda entry: entry.name)
def test_a_hidden_effect_is_found_or_left_open_rightly(entry: Entry, tmp_path: Path) -> None:
    row = try_entry(entry, tmp_path / "answers")
    said = (
        f"hidden {row.hidden or 'nothing'}; said {row.verdict}: {row.named} {row.alternatives} {row.reason}"
    )
    assert row.good == "1", said
    for cell in row.errors.split() if row.outcome == "right" else ():
        key, _, error = cell.partition("=")
        assert abs(float(error)) < FAR, f"{said}; {cell}"
        assert key.partition(".")[2] not in SCALES or abs(float(error)) < FAR / 4, f"{said}; {cell}"
    if row.outcome == "right":
        assert float(row.after_K) < 0.5 * float(row.before_K), said
    if row.outcome == "unknown":
        assert row.localised == "1", said
