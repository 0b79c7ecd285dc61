from __future__ import annotations

import numpy as np
import pytest

from observer.fit.forward import Forward
from observer.fit.parameters import replaced
from observer.fit.runs import joined, prepare
from observer.frames import Quality
from observer.installation import parse
from observer.model.build import build_plant
from observer.tables.sections import Node
from tests.logs.machines import machine, rig
from tests.logs.simulated import made_log, simulated_rows

CHANGED = {
    "surface.convection_W_m2K": 12.0,
    "source.nut.share": 0.7,
    "source.left_bearing.scale": 1.3,
    "source.right_bearing.heat_W_rpm": 0.002,
}


def test_the_sum_of_responses_is_the_simulation() -> None:
    config, blocks = rig()
    run = prepare(config, blocks, "log")
    changed = replaced(config, CHANGED)
    # the same number of modes in both: the predictor keeps that of the configuration it was made for
    changed = changed.model_copy(
        update={"model": changed.model.model_copy(update={"modes": len(build_plant(config).mode_index)})}
    )
    rows = simulated_rows(changed, run)[1]
    [predicted] = Forward(config, [run], tick_s=0.0)(replaced(config, CHANGED))
    # sums of the same numbers in another order: rounding of temperatures of 50 °C over 2e4 steps
    np.testing.assert_allclose(predicted, run.means(rows), rtol=0, atol=1e-9)


def test_the_sum_of_responses_is_the_simulation_beside_a_network_and_an_effect_that_heats() -> None:
    """What links and effects add to the sources belongs to the machine, not to the laws that are fitted."""
    bare = machine()
    block, heater = Node(name="block", capacity_J_K=300.0), bare.source[0].name
    config = parse(
        bare.model_dump(exclude_unset=True)
        | {
            "node": [block.model_dump()],
            "link": [{"between": ["block", heater], "conductance_W_K": 2.0}],
            "source": [
                s.model_dump(exclude_unset=True) | ({"nodes": {"block": 1.0}} if s.name == heater else {})
                for s in bare.source
            ],
            "effect": [{"kind": "motor_heat", "target": "right", "heat_W": 3.0}],
            "model": {"modes": 12},
        }
    )
    log = made_log(bare, seed=2, minutes=10.0)
    run = prepare(config, [log], "log")
    assert len(build_plant(config).source_names) == len(config.source) + 2
    rows = simulated_rows(config, run)[1]
    [predicted] = Forward(config, [run], tick_s=0.0)(config)
    np.testing.assert_allclose(predicted, run.means(rows), rtol=0, atol=1e-9)


def test_blocks_of_frames_join_to_the_whole_log() -> None:
    _, blocks = rig()
    assert len(blocks) > 1
    whole = joined(blocks)
    samples_s, samples_m, offset, *_ = whole.path["nut_position_m"]
    assert len(offset) == len(whole) + 1 == sum(map(len, blocks)) + 1
    column = whole.channels.index("nut_position_m")
    # one sample a row in this log, so the newest sample of each step is the row's own
    np.testing.assert_array_equal(samples_s[offset[1:] - 1], whole.time_s)
    np.testing.assert_array_equal(samples_m[offset[1:] - 1], whole.values[:, column])


def test_means_leave_out_what_is_not_usable() -> None:
    config = machine()
    log = made_log(config, seed=1, minutes=10.0)
    log.values[7:9, 0] = np.nan
    log.values[9:13, 0] = 900.0
    log.fresh[7:13, 0] = False
    log.quality[7:13, 0] = [1, 1, 3, 3, 3, 3]
    run = prepare(config, [log], "log")
    used = [*range(7), 13, 14]  # a row every 2 s
    assert run.count[0, 0] == len(used)
    assert run.measured_degC[0, 0] == pytest.approx(np.mean(log.values[used, 0]), abs=1e-12)
    rows = np.random.default_rng(1).normal(size=(len(log), 3))
    assert run.means(rows)[0, 0] == pytest.approx(np.mean(rows[used, 0]), abs=1e-12)
    assert run.means(rows)[1, 0] == pytest.approx(np.mean(rows[15:30, 0]), abs=1e-12)


def test_what_a_stuck_sensor_showed_before_it_was_known_to_be_stuck_is_left_out() -> None:
    """A log can be read backwards: the whole stretch of equal values goes, and nothing before it."""
    config = machine()
    log = made_log(config, seed=1, minutes=10.0)
    log.values[100:200, 1] = log.values[100, 1]
    log.quality[130:200, 1] = int(Quality.REJECTED)
    log.fresh[130:200, 1] = False
    run = prepare(config, [log], "log")
    assert run.usable[:100, 1].all()
    assert not run.usable[100:200, 1].any()
    assert run.usable[200:, 1].all()
    assert run.usable[:, [0, 2]].all()
