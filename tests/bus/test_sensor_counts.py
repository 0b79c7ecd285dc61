"""Every message says how many sensors its estimate uses, of how many."""

import json
from dataclasses import replace

import numpy as np
import pytest

from observer.bus.codec import EstimateEncoder, decode_estimate, late
from observer.bus.watch import live_line
from observer.frames import EstimateQuality, Layout, Quality
from tests.bus.blocks import LAYOUT, block

PROBED = replace(LAYOUT, sensors=("t1", "t2", "probe"), displacements=("probe",), has_force=True)


def _with_unused(
    quality: Quality, layout: Layout = LAYOUT, of_estimate: EstimateQuality = EstimateQuality.GOOD
):
    estimate = block(layout=layout, quality=int(of_estimate))
    sensor_quality = estimate.sensor_quality.copy()
    sensor_quality[0, 1] = quality
    forces = {name: np.ones((1, 1)) for name in ("force_N", "force_sigma_N", "force_bound_N")}
    return replace(estimate, sensor_quality=sensor_quality, **(forces if layout.has_force else {}))


@pytest.mark.parametrize("quality", list(Quality)[1:])
def test_a_sensor_that_is_not_good_is_not_counted_as_used(quality: Quality) -> None:
    encoder, estimate = EstimateEncoder(LAYOUT, "abcd1234"), _with_unused(quality)
    assert decode_estimate(encoder.cbor(estimate, 0, 7))["sensors_used"] == 1
    for document in encoder.documents.values():
        message = json.loads(document(estimate, 0, 7))
        assert (message["sensors_used"], message["sensors"]) == (1, 2)


def test_an_invalid_estimate_uses_no_sensor() -> None:
    estimate = _with_unused(Quality.GOOD, of_estimate=EstimateQuality.INVALID)
    assert decode_estimate(EstimateEncoder(LAYOUT, "abcd1234").cbor(estimate, 0, 7))["sensors_used"] == 0


def test_a_displacement_sensor_counts_and_a_long_message_decodes_also_when_late() -> None:
    """With displacements and a force the map has more entries than its first byte can count."""
    message = EstimateEncoder(PROBED, "abcd1234").cbor(_with_unused(Quality.EXCLUDED, PROBED), 0, 7)
    assert decode_estimate(message)["sensors_used"] == 2
    assert decode_estimate(late(message))["late"] is True


def test_the_live_line_names_the_sensor_that_a_good_estimate_does_not_use() -> None:
    heat = json.loads(EstimateEncoder(LAYOUT, "abcd1234").heat(_with_unused(Quality.EXCLUDED), 0, 7))
    line = live_line({"heat": heat, "health": {"degraded_sensors": ["t2"]}})
    assert line.startswith("good, but without t2 (1 of 2 sensors): ")
