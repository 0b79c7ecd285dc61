"""What a user must know of an estimator before trusting it: poles, noise gain, observability, warnings."""

from __future__ import annotations

import itertools
from typing import NamedTuple

import numpy as np

from observer.estimators.design import gains
from observer.estimators.design.exact_poles import MOST_STATES, exact_poles
from observer.estimators.design.gains import LuenbergerGain, Refusal
from observer.estimators.design.steady import bandwidth, gain_for
from observer.frames import FloatArray
from observer.model.discretise import StepMatrices, step_matrices
from observer.model.generator import generator, settled_rows
from observer.model.plant import Plant
from observer.tables.estimator import EstimatorSettings

_MOST_SUBSET_SENSORS = 8
_MOST_DESIGN_WORK = 2e7  # states cubed times designs: some ten seconds on a slow computer
_NEARLY_BLIND = 0.1
_ABSURD_NOISE = 1.0


class DesignReport(NamedTuple):
    """How a plant's estimator is designed and what that means.

    Poles in 1/s: `eigenvalues_1_s` (n,) of the plant with its heats, `poles_requested_1_s` (none for a Kalman
    filter), `poles_reached_1_s` recomputed from the closed loop, with many digits where double precision
    misses the requested ones. `noise_gain_W_K`: each estimated heat's σ
    under white noise of 1 K on every sensor. `weakest_mode` is a mode's number, `weakest_mode_sensor` the
    sensor that sees it best, `weakest_mode_share` how much of it. `placed`: whether there is a gain, and
    its poles are where they were asked to be.
    `undetermined`: the sets of lost sensors after which the heats are no longer determined.
    """

    kind: str
    bandwidth_1_s: float | None
    eigenvalues_1_s: FloatArray
    poles_requested_1_s: FloatArray
    poles_reached_1_s: gains.ComplexArray
    noise_gain_W_K: dict[str, float]
    weakest_mode: int
    weakest_mode_sensor: str
    weakest_mode_share: float
    undetermined: tuple[tuple[str, ...], ...]
    placed: bool
    warnings: tuple[str, ...]


def design_report(plant: Plant, settings: EstimatorSettings, *, on_screw: bool = True) -> DesignReport:
    """Design the estimator of the settings and report on it; `on_screw` says whether a sensor sits there.

    Raises `UserError` where no bandwidth serves; a design that is refused is reported, with no poles reached.
    """
    step = step_matrices(plant, settings.period_s)
    omega = bandwidth(plant, settings) if settings.kind == "luenberger" else np.inf
    whole = gain_for(plant, step, gains.everything(plant), settings, omega)
    if isinstance(whole, LuenbergerGain) and _missed(whole) and len(whole.K) <= MOST_STATES:
        poles = exact_poles(plant, step, whole.K)
        whole = whole._replace(poles_reached_1_s=poles[: len(whole.poles_requested_1_s)])
    requested, reached, noise = _outcome(plant, step, whole)
    mode, sensor, share = _weakest_mode(plant)
    names = plant.layout.sensors
    undetermined = _undetermined(plant, step, settings, omega)
    return DesignReport(
        kind=settings.kind,
        bandwidth_1_s=omega if np.isfinite(omega) else None,
        eigenvalues_1_s=np.sort(np.concatenate([_rates(plant), -plant.heat_decay_1_s]))[::-1],
        poles_requested_1_s=requested,
        poles_reached_1_s=reached,
        noise_gain_W_K={name: float(g) for name, g in zip(plant.layout.sources, noise, strict=True)},
        weakest_mode=mode,
        weakest_mode_sensor=names[sensor],
        weakest_mode_share=share,
        undetermined=undetermined,
        placed=not isinstance(whole, Refusal) and not _missed(whole),
        warnings=(
            *_gain_warnings(plant, whole, noise),
            *_sensor_warnings(names[sensor], mode, share, undetermined, on_screw=on_screw),
        ),
    )


def _weakest_mode(plant: Plant) -> tuple[int, int, float]:
    """Return the mode (its number) that the sensors see worst, the sensor (index) that sees it best, and how
    much.

    How much is the mode's shape at that sensor against its largest value anywhere on the grid.
    """
    temperatures = settled_rows(plant)[: plant.rows.sensors + plant.rows.grid, : plant.modes]
    largest = np.abs(temperatures).max(axis=0)
    share = np.abs(temperatures[: plant.rows.sensors]) / np.where(largest > 0, largest, 1.0)
    best = share.max(axis=0)
    mode = int(np.argmin(best))
    return plant.mode_index[mode], int(np.argmax(share[:, mode])), float(best[mode])


def _rates(plant: Plant) -> FloatArray:
    """The plant's own eigenvalues, 1/s; links are as passive as the screw, so that they are real."""
    if not len(plant.coupling.links.source):
        return -plant.decay_1_s
    return np.asarray(np.linalg.eigvals(generator(plant)).real)


def _outcome(
    plant: Plant, step: StepMatrices, whole: LuenbergerGain | FloatArray | Refusal
) -> tuple[FloatArray, gains.ComplexArray, FloatArray]:
    """Poles requested, poles reached and noise gains."""
    if isinstance(whole, LuenbergerGain):
        return whole.poles_requested_1_s, whole.poles_reached_1_s, whole.noise_gain_W_K
    heats = int(plant.estimated.sum())
    if isinstance(whole, Refusal):
        return np.empty(0), np.empty(0, dtype=np.complex128), np.full(heats, np.nan)
    M = gains.closed_loop(plant, step, whole)
    return np.empty(0), gains.poles_of(M, step.dt_s), gains.noise_gain(M, whole, heats)


def _undetermined(
    plant: Plant, step: StepMatrices, settings: EstimatorSettings, omega: float
) -> tuple[tuple[str, ...], ...]:
    """Smallest sets of sensors whose loss leaves no gain; supersets of one found are not listed again."""
    s = plant.rows.sensors
    if s > _MOST_SUBSET_SENSORS:
        return ()
    most = _most_lost(len(step.decay) + len(step.heat_decay), s)
    found: list[frozenset[int]] = []
    sizes = range(1, most + 1)
    for lost in itertools.chain.from_iterable(itertools.combinations(range(s), r) for r in sizes):
        if any(known <= set(lost) for known in found):
            continue
        present = gains.everything(plant)
        present[list(lost)] = False
        if isinstance(gain_for(plant, step, present, settings, omega), Refusal):
            found.append(frozenset(lost))
    return tuple(tuple(plant.layout.sensors[i] for i in sorted(lost)) for lost in found)


def _most_lost(states: int, sensors: int) -> int:
    """How many sensors are taken away together: all, one by one, or none, by what the designs may cost."""
    if states**3 * 2**sensors <= _MOST_DESIGN_WORK:
        return sensors
    return 1 if states**3 * sensors <= _MOST_DESIGN_WORK else 0


def _missed(whole: LuenbergerGain | FloatArray) -> bool:
    """Whether poles were asked for and are not reached."""
    return isinstance(whole, LuenbergerGain) and not whole.pole_error <= gains.POLE_TOLERANCE


def _gain_warnings(
    plant: Plant, whole: LuenbergerGain | FloatArray | Refusal, noise: FloatArray
) -> list[str]:
    if isinstance(whole, Refusal):
        return [
            f"sensors {', '.join(whole.sensors)} do not serve: {whole.reason}; add or move sensors "
            "(observer place) or lower bandwidth_1_s"
        ]
    found = []
    if isinstance(whole, LuenbergerGain) and _missed(whole):
        found.append(
            f"the poles reached are up to {whole.pole_error:.2g} times off those requested: rounding the "
            'gains to double precision moves them so far; use pole_rule = "bandwidth" or kind = "kalman"'
        )
    for name, gain, sigma_W in zip(plant.layout.sources, noise, plant.initial_sigma_W, strict=True):
        noise_W = float(gain * np.sqrt(plant.noise_R_K2.max()))
        if not noise_W <= _ABSURD_NOISE * sigma_W:
            found.append(
                f"sensor noise alone moves the heat of {name} by {noise_W:.3g} W, more than its "
                'initial_sigma_W; lower bandwidth_1_s, move a sensor nearer, or use kind = "kalman"'
            )
    return found


def _sensor_warnings(
    sensor: str, mode: int, share: float, undetermined: tuple[tuple[str, ...], ...], *, on_screw: bool
) -> list[str]:
    """Of a mode that is hardly seen, and of sensors that must not be lost.

    Sensors on bodies alone cannot be moved along the screw, and each serves one heat: that is no warning.
    """
    found = []
    if share < _NEARLY_BLIND and on_screw:
        found.append(
            f"no sensor sees more than {share:.0%} of mode {mode} (best: {sensor}): each sits where it "
            "hardly shows; move one sensor (observer place)"
        )
    single = [lost[0] for lost in undetermined if len(lost) == 1]
    if single and on_screw:
        found.append(
            f"without {' or without '.join(single)} the heats can no longer be distinguished and are only "
            "predicted; add a sensor"
        )
    return found
