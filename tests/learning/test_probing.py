"""What a probing each hour is worth on rough machines of the independent truth."""

from __future__ import annotations

import numpy as np
import pytest

from tests.learning.probing import gain, probed

FRESH_SEED, MACHINES = 9200, 3


@pytest.mark.slow
def test_a_probing_an_hour_makes_the_error_better_known() -> None:
    """Five thermocouples know the error to a micrometre or two already; the probe's zero, to one."""
    found = [gain(probed(FRESH_SEED, i, "abc"[i], housed=False), housed=False) for i in range(MACHINES)]
    rms_um = np.sqrt(np.mean([np.square(one.error_um) for one in found], axis=0))
    assert rms_um[1] < rms_um[0]
    assert np.mean([one.sigma_um[1] / one.sigma_um[0] for one in found]) < 0.85
    assert min(one.covered[1] for one in found) >= 0.9
