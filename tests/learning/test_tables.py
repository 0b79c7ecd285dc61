"""The campaigns' tables on their pages, and what was asked before any seed of the histories was drawn."""

import numpy as np
import pytest

from campaigns.learning import histories, trial
from campaigns.resumable import read_rows


@pytest.mark.parametrize("campaign", [trial, histories], ids=["learning", "identify"])
def test_the_page_has_the_table_of_the_rows_that_are_kept(campaign):
    assert campaign.table(read_rows(campaign.RESULTS)) in campaign.PAGE.read_text(encoding="utf-8")


def test_on_the_mean_machine_true_heats_lie_within_their_bands_in_90_to_98_percent():
    rows = read_rows(histories.RESULTS)
    held = [float(r["covered"]) for r in rows if r["tolerances"] == "as delivered"]
    assert len(held) == 3 * histories.MACHINES
    assert 0.90 <= np.mean(held) <= 0.98
