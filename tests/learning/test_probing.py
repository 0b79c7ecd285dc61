"""What a probing each hour, or a scale, is worth on rough machines of the independent truth."""

from __future__ import annotations

import numpy as np
import pytest

from tests.learning.housings import HOUSED_CONFIG, draw_housed
from tests.learning.machines import CONFIG, day
from tests.learning.probing import EVERY_S, PROBE, SCALE, gained, probed, scaled_log
from tests.truth.machine.machine import stream

FRESH_SEED, MACHINES = 9200, 3
SCALE_SEED = 9400


@pytest.mark.slow
def test_a_probing_an_hour_makes_the_error_better_known() -> None:
    """Five thermocouples know the error to a micrometre or two already; the probe's zero, to one."""
    runs = (probed(FRESH_SEED, i, "abc"[i]) for i in range(MACHINES))
    days = [gained(*one, CONFIG, PROBE, 0.5 * EVERY_S + 60.0) for one in runs]
    found = np.array([[judged["error"] for judged in one] for one in days])
    without, probing = np.sqrt(np.mean(found[:, :, 0] ** 2, axis=0))
    assert probing < without
    assert np.mean(found[:, 1, 2] / found[:, 0, 2]) < 0.85
    assert found[:, 1, 1].min() >= 0.9


@pytest.mark.slow
def test_a_scale_makes_the_error_better_known_where_only_housings_are_measured() -> None:
    machine = draw_housed(SCALE_SEED, 1, 0.2)
    one = day(machine, SCALE_SEED, 1, "b")
    log = scaled_log(one, stream(SCALE_SEED, "scale", "1"))
    found = gained(one, log, HOUSED_CONFIG, SCALE, 1800.0)
    (rms_um, _, sigma_um), (with_um, covered, with_sigma_um) = (judged["error"] for judged in found)
    assert with_um < rms_um
    assert with_sigma_um < 0.85 * sigma_um
    assert covered >= 0.9
