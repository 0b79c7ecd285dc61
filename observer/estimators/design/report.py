"""Report on an estimator before its use: poles, noise gain, observability, warnings."""

from __future__ import annotations

import itertools
from typing import NamedTuple

import numpy as np

from observer.config.estimator import EstimatorSettings
from observer.estimators.design import gains
from observer.estimators.design.exact_poles import MOST_STATES, exact_poles
from observer.estimators.design.gains import LuenbergerGain, Refusal
from observer.estimators.design.steady import bandwidth, gain_for
from observer.frames import FloatArray
from observer.model.discretise import StepMatrices, step_matrices
from observer.model.generator import generator, settled_rows
from observer.model.plant import Plant

_MOST_SUBSET_SENSORS = 8
_MOST_DESIGN_WORK = 2e7  # states cubed times designs: some ten seconds on a slow computer
_NEARLY_BLIND = 0.1
_ABSURD_NOISE = 1.0


class DesignReport(NamedTuple):
    """The design of a plant's estimator; some fields are the keys of `observer check --json`.

    Attributes:
        kind: `kalman` or `luenberger`.
        bandwidth_1_s: Bandwidth in use, 1/s; None for a Kalman filter and under Kim's rule.
        eigenvalues_1_s: Poles of the plant with its heats, 1/s, (n,), the slowest first.
        poles_requested_1_s: Requested poles, 1/s; empty for a Kalman filter.
        poles_reached_1_s: Poles of the closed loop, 1/s. They are recomputed with many digits where double
            precision misses the requested ones.
        noise_gain_W_K: σ of each estimated heat under white noise of 1 K on every sensor, W/K, by source. NaN
            without a gain.
        weakest_mode: Number of the mode that the sensors see worst, from 1.
        weakest_mode_sensor: Name of the sensor that sees it best.
        weakest_mode_share: The mode's shape at that sensor relative to its largest value on the grid.
        undetermined: Smallest sets of sensors without which the heats are not determined. Empty beyond eight
            sensors.
        placed: Whether a gain exists and its poles are the requested ones.
        warnings: Sentences with a remedy, for the user.
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
    """Design the estimator of the settings and report on it.

    A refused design is reported without reached poles. The work on sets of lost sensors is limited, so with
    many states fewer sets are tried.

    Args:
        plant: The model.
        settings: The table `[estimator]`.
        on_screw: Whether a sensor sits on the screw. Without one, warnings about weakly seen modes are
            omitted.

    Raises:
        UserError: If a Luenberger observer has no useful bandwidth.
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
    cosines = plant.modes - plant.bent  # modes that bend under a nut are seen with its node
    temperatures = settled_rows(plant)[: plant.rows.sensors + plant.rows.grid, :cosines]
    largest = np.abs(temperatures).max(axis=0)
    share = np.abs(temperatures[: plant.rows.sensors]) / np.where(largest > 0, largest, 1.0)
    best = share.max(axis=0)
    mode = int(np.argmin(best))
    return plant.mode_index[mode], int(np.argmax(share[:, mode])), float(best[mode])


def _rates(plant: Plant) -> FloatArray:
    """Return the plant's eigenvalues, 1/s; they are real, because screw and links are passive."""
    if not len(plant.coupling.links.source):
        return -plant.decay_1_s
    return np.asarray(np.linalg.eigvals(generator(plant)).real)


def _outcome(
    plant: Plant, step: StepMatrices, whole: LuenbergerGain | FloatArray | Refusal
) -> tuple[FloatArray, gains.ComplexArray, FloatArray]:
    """Return requested poles, reached poles and noise gains."""
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
    """Return the smallest sets of sensors whose loss leaves no gain, without their supersets."""
    s = plant.rows.sensors
    if s > _MOST_SUBSET_SENSORS:
        return ()
    most = _most_lost(len(step.decay) + len(step.heat_decay), s)
    undetermined: list[frozenset[int]] = []
    sizes = range(1, most + 1)
    for lost in itertools.chain.from_iterable(itertools.combinations(range(s), r) for r in sizes):
        if any(smaller <= set(lost) for smaller in undetermined):
            continue
        present = gains.everything(plant)
        present[list(lost)] = False
        if isinstance(gain_for(plant, step, present, settings, omega), Refusal):
            undetermined.append(frozenset(lost))
    return tuple(tuple(plant.layout.sensors[i] for i in sorted(lost)) for lost in undetermined)


def _most_lost(states: int, sensors: int) -> int:
    """Return the largest number of sensors removed together, limited by the work of the designs."""
    if states**3 * 2**sensors <= _MOST_DESIGN_WORK:
        return sensors
    return 1 if states**3 * sensors <= _MOST_DESIGN_WORK else 0


def _missed(whole: LuenbergerGain | FloatArray) -> bool:
    """Return whether requested poles are not reached."""
    return isinstance(whole, LuenbergerGain) and not whole.pole_error <= gains.POLE_TOLERANCE


def _gain_warnings(
    plant: Plant, whole: LuenbergerGain | FloatArray | Refusal, noise: FloatArray
) -> list[str]:
    if isinstance(whole, Refusal):
        return [
            f"sensors {', '.join(whole.sensors)} do not serve: {whole.reason}; add or move sensors "
            "(observer place) or lower bandwidth_1_s"
        ]
    messages = []
    if isinstance(whole, LuenbergerGain) and _missed(whole):
        messages.append(
            f"the poles reached are up to {whole.pole_error:.2g} times off those requested: rounding the "
            'gains to double precision moves them so far; use pole_rule = "bandwidth" or kind = "kalman"'
        )
    for name, gain, sigma_W in zip(plant.layout.sources, noise, plant.initial_sigma_W, strict=True):
        noise_W = float(gain * np.sqrt(plant.noise_R_K2.max()))
        if not noise_W <= _ABSURD_NOISE * sigma_W:
            messages.append(
                f"sensor noise alone moves the heat of {name} by {noise_W:.3g} W, more than its "
                'initial_sigma_W; lower bandwidth_1_s, move a sensor nearer, or use kind = "kalman"'
            )
    return messages


def _sensor_warnings(
    sensor: str, mode: int, share: float, undetermined: tuple[tuple[str, ...], ...], *, on_screw: bool
) -> list[str]:
    """Return warnings about a weakly observed mode, and about sensors that must not be lost.

    Sensors that are all on bodies cause no warning: each serves one heat, at a fixed place.
    """
    messages = []
    if share < _NEARLY_BLIND and on_screw:
        messages.append(
            f"no sensor sees more than {share:.0%} of mode {mode} (best: {sensor}): each sits where it "
            "hardly shows; move one sensor (observer place)"
        )
    single = [lost[0] for lost in undetermined if len(lost) == 1]
    if single and on_screw:
        messages.append(
            f"without {' or without '.join(single)} the heats can no longer be distinguished and are only "
            "predicted; add a sensor"
        )
    return messages
