"""What a probing each hour, or a scale, is worth on rough machines of the independent truth."""

from __future__ import annotations

import numpy as np
import pytest

from tests.learning.housings import HOUSED_CONFIG, draw_housed
from tests.learning.machines import day
from tests.learning.probing import SCALE, gain, gained, probed, scaled_log
from tests.truth.machine.machine import stream

FRESH_SEED, MACHINES = 9200, 3
SCALE_SEED = 9400


@pytest.mark.slow
def test_a_probing_an_hour_makes_the_error_better_known() -> None:
    """Five thermocouples know the error to a micrometre or two already; the probe's zero, to one."""
    found = [gain(probed(FRESH_SEED, i, "abc"[i], housed=False), housed=False) for i in range(MACHINES)]
    rms_um = np.sqrt(np.mean([np.square(one.error_um) for one in found], axis=0))
    assert rms_um[1] < rms_um[0]
    assert np.mean([one.sigma_um[1] / one.sigma_um[0] for one in found]) < 0.85
    assert min(one.covered[1] for one in found) >= 0.9


@pytest.mark.slow
def test_a_scale_makes_the_error_better_known_where_only_housings_are_measured() -> None:
    machine = draw_housed(SCALE_SEED, 1, 0.2)
    one = day(machine, SCALE_SEED, 1, "b")
    log = scaled_log(one, stream(SCALE_SEED, "scale", "1"))
    found = gained(one, log, (HOUSED_CONFIG, HOUSED_CONFIG + SCALE), one.time_s[0] + 1800.0)
    assert found.error_um[1] < found.error_um[0]
    assert found.sigma_um[1] < 0.85 * found.sigma_um[0]
    assert found.covered[1] >= 0.9
