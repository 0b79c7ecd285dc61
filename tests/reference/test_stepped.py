"""Screws with sections of their own diameter and bore, against finite volumes of their own and closed forms.

The limits were set before the seeds were drawn.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from observer.installation import parse
from observer.model.build import build_plant
from tests.reference.service_path import open_loop, replay
from tests.reference.stepped_cases import SLIDES_AIR_degC, STEP_s, drawn, seen, two_slides, with_true_heats

LARGEST = 0.005
"""The largest difference of temperatures and thermal errors after the first minute, in which a lag that is
taken as settled shows, as a part of the largest rise and error.
"""
FIRST_s = 60.0
SETTLED_s = 1200.0


@pytest.mark.parametrize("seed", range(200, 206))
def test_a_stepped_screw_warms_and_grows_as_finite_volumes_do(seed: int) -> None:
    """A moving nut crosses edges, ends lose heat, and in half of all cases turning adds to the film."""
    found = seen(drawn(seed))
    after = slice(round(FIRST_s / STEP_s), None)
    rise_K, error_um = float(np.ptp(found.degC)), float(np.abs(found.um).max())
    off_K = float(np.abs(found.model_degC - found.degC)[after].max())
    off_um = float(np.abs(found.model_um - found.um)[after].max())
    print(f"{seed}: {off_K:.4f} K of {rise_K:.1f} K, {off_um:.3f} µm of {error_um:.1f} µm")
    assert off_K <= LARGEST * rise_K
    assert off_um <= LARGEST * error_um


def rod_at_rest(**tables: Any) -> np.ndarray:
    """The field per W of a heat at the left end."""
    table: dict[str, Any] = {
        "ambient": {"temperature_degC": 20.0},
        "source": [{"name": "end", "shape": "point", "position_m": 0.0, "power_channel": "end_W"}],
        "sensor": [{"name": "t1", "channel": "t1_degC", "position_m": 0.1}],
    }
    plant = build_plant(parse(table | tables))
    return plant.rows.C[plant.rows.field_slice] @ (plant.B[:, 0] / plant.decay_1_s)


STEEL = {"conductivity_W_mK": 50.0, "density_kg_m3": 7800.0, "specific_heat_J_kgK": 460.0}


def test_two_sections_in_series_are_at_rest_as_by_hand() -> None:
    """Without a film, q passes both to a prescribed end: T falls by q x/(k A) of each section."""
    thin_piece = {"from_m": 0.2, "to_m": 0.5, "diameter_m": 0.02}
    field_K = rod_at_rest(
        screw={"length_m": 0.5, "diameter_m": 0.03, "section": [thin_piece], **STEEL},
        boundary={"right": {"kind": "prescribed", "channel": "right_degC"}},
        output={"positions_m": [0.0, 0.1, 0.2, 0.35, 0.5]},
    )
    thick, thin = (4.0 / (50.0 * math.pi * d_m**2) for d_m in (0.03, 0.02))
    wanted = [0.2 * thick + 0.3 * thin, 0.1 * thick + 0.3 * thin, 0.3 * thin, 0.15 * thin, 0.0]
    assert field_K == pytest.approx(wanted, rel=1e-9, abs=1e-9)


def test_a_fin_of_two_sections_is_at_rest_as_by_hand() -> None:
    """T(0) = q/(k A1 m1) (1 + r t1)/(t1 + r), t = tanh(m l) of each and r = k A2 m2 t2/(k A1 m1): a fin whose
    end loses what the next one takes (Incropera & DeWitt 2007, §3.6).
    """
    tube = {"from_m": 0.25, "to_m": 0.6, "diameter_m": 0.025, "bore_m": 0.01}
    field_K = rod_at_rest(
        screw={"length_m": 0.6, "diameter_m": 0.04, "section": [tube], **STEEL},
        surface={"convection_W_m2K": 25.0},
        output={"positions_m": [0.0, 0.6]},
    )
    kA = [50.0 * math.pi / 4.0 * s for s in (0.04**2, 0.025**2 - 0.01**2)]
    m = [math.sqrt(25.0 * math.pi * d / c) for d, c in zip((0.04, 0.025), kA, strict=True)]
    first, second = math.tanh(m[0] * 0.25), math.tanh(m[1] * 0.35)
    ratio = kA[1] * m[1] * second / (kA[0] * m[0])
    assert field_K[0] == pytest.approx((1.0 + ratio * first) / (kA[0] * m[0] * (first + ratio)), rel=1e-9)


def test_the_heats_of_two_nuts_are_estimated_with_a_sigma_that_holds() -> None:
    """Four heats that differ from their laws by up to half, on three machines; and so do field and error."""
    heats, along, off_W = [], [], []
    for seed in range(3):
        this = two_slides(seed)
        block = replay(this.config, this.log)
        late = (this.log.time_s >= SETTLED_s) & this.turns
        apart_W = block.heat_W[late] - this.heat_W
        heats.append(np.mean(np.abs(apart_W) <= 1.96 * block.heat_sigma_W[late], axis=0))
        off_W.append(np.sqrt(np.mean(apart_W**2, axis=0)))
        last = int(this.turns.sum()) - 1
        along += [
            np.abs(block.field_degC[last] - this.field_degC) <= 1.96 * block.field_sigma_K[last],
            np.abs(block.error_um[last] - this.error_um) <= 1.96 * block.error_sigma_um[last] + 1e-9,
        ]
    print(np.round(heats, 3), np.round(off_W, 2), np.mean(along))
    assert np.mean(heats, axis=0).min() >= 0.9
    assert np.mean(along) >= 0.9
    assert np.max(off_W) < 2.0


def test_what_a_uniform_screw_gets_wrong_is_what_the_page_says() -> None:
    """With the true heats: docs/explanation/model.md."""
    this = two_slides(5)
    config, last = with_true_heats(this), int(this.turns.sum()) - 1
    uniform = config.model_copy(update={"screw": config.screw.model_copy(update={"section": ()})})
    off = []
    for own in (config, uniform):
        plant, rows = open_loop(own, this.log, SLIDES_AIR_degC)
        off_K = np.abs(rows[last, plant.rows.field_slice] - this.field_degC).max()
        off.append((off_K, np.abs(rows[last, plant.rows.error_slice] - this.error_um).max()))
    print(np.round(off, 3))
    assert off[0] < (0.02, 0.02)
    assert off[1] == pytest.approx((5.2, 23.0), abs=0.5)
