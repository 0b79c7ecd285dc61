"""One Kalman step, in the loop: compiled engine, bare compiled loop, filterpy, statsmodels."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
from filterpy.kalman import KalmanFilter
from scipy.linalg import block_diag
from statsmodels.tsa.statespace.kalman_filter import KalmanFilter as StatsmodelsFilter

from benchmarks import bare
from benchmarks.plants import dense
from benchmarks.table import Result, judged
from benchmarks.timing import medians_s, shown
from observer.config.estimator import Integrity
from observer.estimators.bank import Design
from observer.estimators.kalman import KalmanEstimator
from observer.estimators.packing import padded_width
from observer.frames import FloatArray, Inputs
from observer.kernels.layout import pad_rows
from observer.library.machine import load
from observer.model.build import build_plant
from observer.model.discretise import step_matrices
from observer.model.plant import Plant
from tests.logs.inputs import even_inputs
from tests.logs.machines import config_of
from tests.logs.plants import moving_columns

CONFIG = Path(__file__).resolve().parents[1] / "config"
COUPLED = ("demo-housings", "yu-dual-drive")
DT_S = 0.5
PERIOD_S, MOST_OF_A_CORE = 0.1, 0.03
NUT_STEP = 0.013  # part of its way that a nut goes in a step
OURS_STEPS, FILTERPY_STEPS, STATSMODELS_STEPS = 20_000, 500, 2_000
GOAL = {8: 35.0, 40: 12.0}
GOAL_LEARNING = {8: 14.0, 40: 9.0}
"""By modes: times as fast as filterpy, alone and with what is learnt as so many states more."""
GOAL_COUPLED = 1.0
"""Times as fast as a dense step in numpy, which multiplies by registers but makes no use of the structure."""


def results() -> list[Result]:
    """8 modes and 3 heats with 4 sensors, then 40 modes with 8; and each with what it learns by default."""
    rows = []
    for modes, sensors in ((8, 4), (40, 8)):
        config = config_of(modes, sensors, grid=2)
        plant = build_plant(config)
        inputs = even_inputs(plant, OURS_STEPS)
        estimator = KalmanEstimator(plant, config.estimator)
        works = {
            "ours": ours_loop(estimator, inputs),
            "bare": bare_loop(plant, inputs),
            "filterpy": filterpy_loop(plant, inputs.y_degC[:FILTERPY_STEPS]),
            "statsmodels": statsmodels_filter(plant, inputs.y_degC[:STATSMODELS_STEPS]),
        }
        taken = medians_s(works)
        steps = {"filterpy": FILTERPY_STEPS, "statsmodels": STATSMODELS_STEPS}
        step_s = {name: taken[name] / steps.get(name, OURS_STEPS) for name in taken}
        size = f"{modes} modes + 3 lags + 3 heats, {sensors} sensors"
        ours = shown(step_s["ours"])

        def times(peer: str, step_s: dict[str, float] = step_s) -> float:
            return step_s[peer] / step_s["ours"]

        shows = {peer: f"{peer} {shown(value)}" for peer, value in step_s.items()}
        name = f"Kalman step, {size}"
        rows.append(judged(name, ours, shows["filterpy"], times("filterpy"), at_least=GOAL[modes]))
        least = Result("  the least by hand", ours, shows["bare"], f"{1 / times('bare'):.3g} ×")
        rows.append(least)
        rows.append(Result("  and statsmodels", ours, shows["statsmodels"], f"{times('statsmodels'):.3g} ×"))
        rows.append(learning(modes, sensors))
        rows.append(with_a_bank(modes, sensors))
    return [*rows, *(coupled(name) for name in COUPLED)]


def coupled(name: str) -> Result:
    """The step of a machine with bodies beside its screw, whose nuts move in every step, and a dense one of
    as many states in numpy.
    """
    config = load(CONFIG / f"{name}.toml").config
    plant = build_plant(config, learns=True)
    steps = OURS_STEPS // 40
    to_and_fro = np.abs(np.arange(steps) * NUT_STEP % 2.0 - 1.0)
    moving_B, moving_C = moving_columns(plant, config.screw.length_m * (0.2 + 0.6 * to_and_fro))
    estimator = KalmanEstimator(plant, config.estimator)
    n = len(plant.decay_1_s) + int(plant.estimated.sum()) + plant.learnt
    inputs = even_inputs(plant, steps)._replace(moving_B=moving_B, moving_C=moving_C)
    taken = medians_s(
        {"ours": ours_loop(estimator, inputs), "numpy": numpy_loop(n, plant.rows.sensors, steps)}
    )
    ours_s, numpy_s = taken["ours"] / steps, taken["numpy"] / steps
    size = f"{name}: {n} states, {len(plant.coupling.links.source)} links to the nut"
    return judged(
        f"Kalman step, {size}",
        shown(ours_s),
        f"dense numpy {shown(numpy_s)}",
        numpy_s / ours_s,
        at_least=GOAL_COUPLED,
    )


def numpy_loop(n: int, sensors: int, steps: int) -> Callable[[], object]:
    """A Kalman step of n states in dense matrices, so many times."""
    rng = np.random.default_rng(0)
    A = 0.9 * np.eye(n) + 0.001 * rng.standard_normal((n, n))
    H, Q, R = rng.standard_normal((sensors, n)), np.eye(n), np.eye(sensors)

    def work() -> object:
        P = np.eye(n)
        for _ in range(steps):
            P = A @ P @ A.T + Q
            K = np.linalg.solve(H @ P @ H.T + R, H @ P).T
            P = P - K @ (H @ P)
        return P

    return work


def learning(modes: int, sensors: int) -> Result:
    """The step that learns beside filterpy's of as many states, whose matrices stay the same."""
    config = config_of(modes, sensors, grid=2)
    plant = build_plant(config, learns=True)
    inputs, steps = even_inputs(plant, OURS_STEPS // 4), OURS_STEPS // 4
    estimator = KalmanEstimator(plant, config.estimator)
    taken = medians_s(
        {
            "ours": ours_loop(estimator, inputs),
            "filterpy": filterpy_loop(plant, inputs.y_degC[:FILTERPY_STEPS], plant.learnt),
        }
    )
    ours, peer = taken["ours"] / steps, taken["filterpy"] / FILTERPY_STEPS
    name = f"  the same, {plant.learnt} parameters learnt"
    return judged(name, shown(ours), f"filterpy {shown(peer)}", peer / ours, at_least=GOAL_LEARNING[modes])


def with_a_bank(modes: int, sensors: int) -> Result:
    """What the bank of filters takes of a core at 10 Hz, beside the step that learns."""
    config = config_of(modes, sensors, grid=2)
    plant = build_plant(config, learns=True)
    steps = OURS_STEPS // 4
    time_s = PERIOD_S * np.arange(steps, dtype=float)
    inputs = even_inputs(plant, steps)._replace(time_s=time_s, dt_s=np.full(steps, PERIOD_S))
    alone = KalmanEstimator(plant, config.estimator)
    beside = KalmanEstimator(plant, config.estimator, Integrity())
    taken = medians_s(
        {
            "alone": ours_loop(alone, inputs),
            "beside": ours_loop(beside, inputs),
        }
    )
    share = (taken["beside"] - taken["alone"]) / (steps * PERIOD_S)
    filters = len(Design.of(np.ones(sensors, dtype=bool), Integrity()).uses)
    name = f"  the bank of {filters} filters at 10 Hz"
    return Result(name, f"{share:.4%} of a core", goal="≤ 3 %", met=share <= MOST_OF_A_CORE)


def ours_loop(estimator: KalmanEstimator, inputs: Inputs) -> Callable[[], object]:
    """The product's filter over the log, from its initial state."""
    return lambda: estimator.run(estimator.initial(), inputs)


def bare_loop(plant: Plant, inputs: Inputs) -> Callable[[], object]:
    """The bare loop over the same steps."""
    step = step_matrices(plant, DT_S)
    _, Qd, _ = dense(plant, DT_S)
    n_x, m = plant.B.shape
    width = padded_width(n_x + m)

    def padded(array: FloatArray) -> FloatArray:
        return pad_rows(array, width)

    decay, hold = padded(np.concatenate([step.decay, step.heat_decay])), padded(step.hold)
    forced = padded(plant.B @ inputs.law_W[0] + plant.E @ inputs.z_end[0])
    G, C = padded(plant.B.T * step.couple), padded(plant.rows.C)
    C, rows = C[: plant.rows.sensors].copy(), C[plant.rows.field_slice].copy()
    y = inputs.y_degC - inputs.z_end @ plant.rows.F[plant.rows.sensor_slice].T
    heat, field = np.empty((len(y), m, 2)), np.empty((len(y), plant.rows.grid, 2))

    def work() -> object:
        x = padded(20.0 * plant.uniform)
        x[plant.modes : n_x] = inputs.law_W[0]  # lags settled, as the engine starts
        P = padded(start_covariance(plant))
        bare.run(decay, hold, G, padded(Qd), C, rows, plant.noise_R_K2, forced, y, x, P, heat, field)
        return heat

    return work


def start_covariance(plant: Plant) -> FloatArray:
    """The covariance before the first sample."""
    n_x, m = plant.B.shape
    P = np.zeros((n_x + m, n_x + m))
    P[:n_x, :n_x] = plant.prior_P
    P[n_x:, n_x:] = np.diag(plant.initial_sigma_W**2)
    return P


def filterpy_loop(plant: Plant, y: FloatArray, more: int = 0) -> Callable[[], object]:
    """filterpy's predict and update, then the same outputs: heats, field and their σ; `more` states stay."""
    Ad, Qd, H = dense(plant, DT_S)
    P = block_diag(start_covariance(plant), np.eye(more))
    Ad, Qd, H = block_diag(Ad, np.eye(more)), block_diag(Qd, np.zeros((more, more))), pad_rows(H, len(P))
    outputs = np.zeros((plant.rows.grid + plant.B.shape[1], len(Ad)))
    outputs[: plant.rows.grid, : len(plant.B)] = plant.rows.C[plant.rows.field_slice]
    outputs[plant.rows.grid :, len(plant.B) : len(Ad) - more] = np.eye(plant.B.shape[1])

    def work() -> object:
        kf = KalmanFilter(dim_x=len(Ad), dim_z=len(H))
        kf.F, kf.Q, kf.H, kf.R, kf.P = Ad, Qd, H, np.diag(plant.noise_R_K2), P
        for row in y:
            kf.predict()
            kf.update(row[:, None])
            read = outputs @ kf.x, np.sqrt(np.einsum("ra,ab,rb->r", outputs, kf.P, outputs))
        return read

    return work


def statsmodels_filter(plant: Plant, y: FloatArray) -> Callable[[], object]:
    """statsmodels' compiled batch filter."""
    Ad, Qd, H = dense(plant, DT_S)
    n = len(Ad)
    kf = StatsmodelsFilter(k_endog=len(H), k_states=n, k_posdef=n)
    kf.bind(np.ascontiguousarray(y))
    kf["design"], kf["transition"], kf["selection"] = H, Ad, np.eye(n)
    kf["obs_cov"], kf["state_cov"] = np.diag(plant.noise_R_K2), Qd
    kf.initialize_known(np.zeros(n), start_covariance(plant))
    kf.tolerance = 0.0  # or it would stop updating the covariance once that has settled
    work: Callable[[], object] = kf.filter
    return work
