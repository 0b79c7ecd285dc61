"""A forecast as the document that is published and written."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from observer.config.machine import Config
from observer.forecast.ahead import Runner, ahead
from observer.forecast.program import Program
from observer.forecast.settling import Settled, settling_of_all
from observer.frames import BoolArray, EstimateBlock, EstimateQuality, FloatArray
from observer.model.plant import Plant

MOST_TIMES, MOST_PLACES = 61, 21
HOTTEST_degC = 1000.0
"""No model holds beyond: steel softens, and oil burns long before."""


@dataclass(frozen=True, slots=True)
class Forecast:
    """The prediction from the present moment on.

    Attributes:
        now_s: The present moment, s since the epoch.
        program: The program that it assumes.
        ahead: Estimates of the next hours, with times from now.
        settled: The state to which the program leads.
    """

    now_s: float
    program: Program
    ahead: EstimateBlock
    settled: Settled


def forecast(
    config: Config,
    begins: Sequence[tuple[float, Runner]],
    program: Program,
    hours: float,
    within_um: float,
) -> Forecast:
    """Forecast from weighted runners: mean and σ of their mixture.

    Args:
        config: The machine.
        begins: Runners at the present moment, with weights that add up to 1.
        program: The program.
        hours: How far ahead, h.
        within_um: Distance from the settled error that counts as settled, µm.

    Raises:
        ValueError: If the laws heat the screw beyond `HOTTEST_degC`.
    """
    now = begins[0][1]
    settled = settling_of_all(begins, program, travel_of(config, now.plant.layout.position_m), within_um)
    blocks = [ahead(begin, program, 3600.0 * hours) for _, begin in begins]
    block = mixture(blocks, np.array([weight for weight, _ in begins]))
    return plausible(Forecast(now.state.time_s, program, block, settled))


def mixture(blocks: Sequence[EstimateBlock], weight: FloatArray) -> EstimateBlock:
    """Return one block with mean and σ of field and error over several.

    The variance of a mixture is Σ w (σ² + (mean − common mean)²). All other columns are those of the first
    block.

    Args:
        blocks: Blocks of the same steps.
        weight: Weights that add up to 1.
    """
    moments = {}
    for name, sigma in (("field_degC", "field_sigma_K"), ("error_um", "error_sigma_um")):
        means, sigmas = (np.array([getattr(b, n) for b in blocks]) for n in (name, sigma))
        moments[name] = np.tensordot(weight, means, 1)
        moments[sigma] = np.sqrt(np.tensordot(weight, sigmas**2 + (means - moments[name]) ** 2, 1))
    return replace(blocks[0], **moments)


def plausible(result: Forecast) -> Forecast:
    """Return a forecast in which every number is finite.

    A settled state beyond all limits has no σ and no time.

    Args:
        result: The forecast.

    Raises:
        ValueError: If the hours ahead are beyond the limits; the message names what to check.
    """
    block, settled = result.ahead, result.settled
    if not _within_limits(block.field_degC, block.field_sigma_K, block.error_um, block.error_sigma_um):
        raise ValueError(
            f"within {block.time_s[-1] / 3600.0:.3g} h the laws heat the screw beyond {HOTTEST_degC:g} °C; "
            "check in the configuration the heat laws (torque_Nm, heat_W_rpm, scale), the film, and effects "
            "by which a heat grows as the screw warms"
        )
    spread = (a for a in (settled.field_sigma_K, settled.error_sigma_um) if a is not None)
    if _within_limits(settled.field_degC, settled.error_um, *spread):
        return result
    return replace(result, settled=Settled(settled.field_degC, settled.error_um, None))


def _within_limits(field_degC: FloatArray, *others: FloatArray) -> bool:
    """Whether a field is finite and no hotter than `HOTTEST_degC`, and other values are finite."""
    finite = all(bool(np.isfinite(values).all()) for values in (field_degC, *others))
    return finite and bool(np.max(np.abs(field_degC), initial=0.0) <= HOTTEST_degC)


def travel_of(config: Config, x_m: FloatArray) -> BoolArray:
    """Return which places the nuts travel over, (g,); all if none moves.

    Args:
        config: The machine; a nut without a stroke travels over the whole screw.
        x_m: Places of the grid, m, (g,).
    """
    strokes = [
        s.stroke_m or (0.0, config.screw.length_m) for s in config.source if s.position_channel is not None
    ]
    in_strokes = [(x_m >= low - 1e-9) & (x_m <= high + 1e-9) for low, high in strokes]
    travelled = np.any(in_strokes, axis=0) if in_strokes else np.ones(len(x_m), np.bool_)
    return np.asarray(travelled if travelled.any() else np.ones(len(x_m), np.bool_))


def thinned(count: int, limit: int) -> list[int]:
    """Return at most `limit` indices of `count`, evenly spread, with the first and the last.

    Args:
        count: Number of values.
        limit: Largest number of indices, 2 or more.
    """
    return sorted({int(i) for i in np.linspace(0, count - 1, min(count, limit)).round()})


def document(
    result: Forecast, plant: Plant, quality: EstimateQuality, instance: str, within_um: float
) -> dict[str, Any]:
    """Return the forecast as a JSON object, as it is published under `forecast`.

    At most 61 times and 21 places are listed. Numbers are rounded to four decimals.

    Args:
        result: The forecast.
        plant: Model of the estimate, for places and the error.
        quality: Quality of the estimate from which it starts, which becomes that of the forecast.
        instance: Identifier of the service's run.
        within_um: Distance that counts as settled, µm.
    """
    times, places = thinned(len(result.ahead.time_s), MOST_TIMES), thinned(plant.rows.grid, MOST_PLACES)
    good = quality is EstimateQuality.GOOD
    has_error = plant.layout.has_error

    def table(values: FloatArray) -> list[list[float]] | None:
        return np.round(values[np.ix_(times, places)], 4).tolist() if values.shape[1] else None

    def along(values: FloatArray | None) -> list[float] | None:
        if values is None or not values.size or not np.isfinite(values).all():
            return None
        rounded: list[float] = np.round(values[places], 4).tolist()
        return rounded

    after_s, between_s = result.settled.after_s, result.settled.between_s
    reason = None if good else f"the estimate that it begins from is {quality.label}"
    return no_forecast(result.now_s, quality, instance, reason, within_um) | {
        "program": {
            "kind": result.program.kind, "period_s": result.program.period_s, "text": result.program.text
        },
        "at_s": (result.now_s + result.ahead.time_s[times]).tolist(),
        "position_m": plant.layout.position_m[places].tolist(),
        "temperature_degC": table(result.ahead.field_degC),
        "sigma_K": table(result.ahead.field_sigma_K),
        "error_um": table(result.ahead.error_um) if has_error else None,
        "error_sigma_um": table(result.ahead.error_sigma_um) if has_error else None,
        "settled_degC": along(result.settled.field_degC),
        "settled_sigma_K": along(result.settled.field_sigma_K),
        "settled_error_um": along(result.settled.error_um) if has_error else None,
        "settled_error_sigma_um": along(result.settled.error_sigma_um) if has_error else None,
        "settled_at_s": None if after_s is None else result.now_s + after_s,
        "settled_between_s": None if between_s is None else [round(result.now_s + s, 1) for s in between_s],
    }  # fmt: skip


def no_forecast(
    now_s: float, quality: EstimateQuality, instance: str, reason: str | None, within_um: float
) -> dict[str, Any]:
    """Return the same object without a forecast.

    Args:
        now_s: The present moment, s since the epoch.
        quality: Quality of the estimate.
        instance: Identifier of the service's run.
        reason: Sentence that says why there is none, or None.
        within_um: Distance that counts as settled, µm.
    """
    return {
        "time_s": now_s, "instance": instance, "quality": quality.label, "reason": reason,
        "program": {"kind": "standstill", "period_s": None, "text": "not known"},
        "at_s": [], "position_m": [], "temperature_degC": [], "sigma_K": [], "error_um": None,
        "error_sigma_um": None, "settled_degC": None, "settled_sigma_K": None, "settled_error_um": None,
        "settled_error_sigma_um": None, "settled_at_s": None, "settled_between_s": None,
        "settles_within_um": within_um,
    }  # fmt: skip


def sentences(result: Forecast, plant: Plant, within_um: float) -> list[str]:
    """Return the forecast as sentences, with 95 % intervals.

    Args:
        result: The forecast.
        plant: Model of the estimate. Without a thermal error only the warmest place is named.
        within_um: Distance that counts as settled, µm.
    """
    ahead_, last = result.ahead, -1
    i = int(np.argmax(ahead_.field_degC[last]))
    hours = ahead_.time_s[last] / 3600.0
    text = (
        f"In {hours:.3g} h ({result.program.text}) the warmest place, "
        f"{1000 * plant.layout.position_m[i]:.0f} mm, "
        f"is at {ahead_.field_degC[last, i]:.1f} ± {1.96 * ahead_.field_sigma_K[last, i]:.1f} °C"
    )
    if plant.layout.has_error:
        j = int(np.argmax(np.abs(ahead_.error_um[last])))
        text += (
            f" and the thermal error at {1000 * plant.layout.position_m[j]:.0f} mm "
            f"{ahead_.error_um[last, j]:.1f} ± {1.96 * ahead_.error_sigma_um[last, j]:.1f} µm"
        )
    lines = [text + "."]
    if plant.layout.has_error:
        lines += [*_settling_place(result.settled, plant), _settles(result, within_um)]
    return lines


def _settling_place(settled: Settled, plant: Plant) -> list[str]:
    """Return the sentence about the warmest place and the largest error after settling."""
    if settled.field_sigma_K is None or settled.error_sigma_um is None:
        return []
    i, j = int(np.argmax(settled.field_degC)), int(np.argmax(np.abs(settled.error_um)))
    place_mm = 1000 * plant.layout.position_m
    return [
        f"It settles with {place_mm[i]:.0f} mm at {settled.field_degC[i]:.1f} ± "
        f"{1.96 * settled.field_sigma_K[i]:.1f} °C and the thermal error at {place_mm[j]:.0f} mm at "
        f"{settled.error_um[j]:.1f} ± {1.96 * settled.error_sigma_um[j]:.1f} µm."
    ]


def _settles(result: Forecast, within_um: float) -> str:
    """Return the sentence about the time until the travel settles."""
    after_s, between_s = result.settled.after_s, result.settled.between_s
    target = f"within {within_um:g} µm of where it settles"
    if after_s is None or between_s is None:
        return f"The travel does not come {target} in a day."
    low, high = (s / 60.0 for s in between_s)
    moment = "now" if after_s == 0.0 else f"after {after_s / 60:.0f} min"
    return f"The travel is {target} {moment} (95 %: {low:.0f} to {high:.0f} min)."
