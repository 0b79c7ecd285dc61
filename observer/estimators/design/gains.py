"""Design of the Luenberger gains: pole placement for the augmented pair [x | δ] in discrete time.

Only the slow part is moved. Modes faster than the bandwidth, and the lags, keep their poles. In coordinates
decoupled from the heats their gain is zero. The closed loop is then block triangular and its spectrum exact.
Design is for the predict-correct form: eig((I - K C) Ad) = exp(p dt).

Kim's gains, for one sensor and one heat, are in closed form. The augmented pair is dη/dt = -Λη + B u,
du/dt = 0, y = C η. The observer's error obeys [[A - L C, B], [-k C, 0]].
"""

from __future__ import annotations

import itertools
import warnings
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import eigvals
from scipy.optimize import linear_sum_assignment

from observer.frames import BoolArray, FloatArray
from observer.model.caching import cached
from observer.model.discretise import StepMatrices, step_matrices
from observer.model.generator import design_step, frozen
from observer.model.plant import Plant

ComplexArray = NDArray[np.complex128]

POLE_TOLERANCE = 0.01
_SPREAD = 0.15
_FASTEST_PER_STEP = 2.0
_NEGLIGIBLE_Z = 1e-6
_BELIEVED = 1e-6  # relative residual of the Lyapunov equation up to which its solution is believed
_ROUNDING = 1e-10
_DOUBLINGS = 48  # the slowest loop that counts as stable has decayed after 2^40 steps
# Poles are exact from the first iteration; the others only make the gain more robust, and they are dear.
_ITERATIONS = 10


class SlowPair(NamedTuple):
    """The part of the augmented pair that is moved, its fast part decoupled.

    With n_s slow states [slow modes | δ] and n_f fast ones.

    Attributes:
        slow: Modes that are moved.
        fast: Other states of the plant, (n_f,).
        A: Transition of the slow states, (n_s, n_s).
        C: Rows of the sensors, (s, n_s).
        V: Displacement of the fast states by a unit of δ, (n_f, m_e).
        scale: Prior σ of each slow state, (n_s,).
    """

    slow: NDArray[np.int64]
    fast: NDArray[np.int64]
    A: FloatArray
    C: FloatArray
    V: FloatArray
    scale: FloatArray


class LuenbergerGain(NamedTuple):
    """A gain with its poles and its noise gain.

    Attributes:
        K: The gain, (n, s), with zero columns for absent sensors.
        poles_requested_1_s: Requested poles of the whole closed loop, 1/s, the slowest first. Modes that
            vanish within one step are left out.
        poles_reached_1_s: Poles that the gain reaches, 1/s, as many.
        noise_gain_W_K: σ of each heat under white noise of 1 K on each sensor, W/K, (m_e,).
    """

    K: FloatArray
    poles_requested_1_s: FloatArray
    poles_reached_1_s: ComplexArray
    noise_gain_W_K: FloatArray

    @property
    def pole_error(self) -> float:
        """Largest distance between requested and reached poles, relative to the requested one."""
        return pole_error(self.poles_requested_1_s, self.poles_reached_1_s)


class Refusal(NamedTuple):
    """The reason why a set of sensors has no gain.

    Attributes:
        sensors: Names of the sensors that are present.
        reason: A clause without a full stop, for messages.
    """

    sensors: tuple[str, ...]
    reason: str


def refusal(plant: Plant, present: BoolArray, reason: str) -> Refusal:
    """Return the refusal of a set of sensors.

    Args:
        plant: The model, which gives the names.
        present: True for the sensors that are present, (s,).
        reason: A clause without a full stop, for messages.
    """
    return Refusal(tuple(itertools.compress(plant.layout.sensors, present)), reason)


def everything(plant: Plant) -> BoolArray:
    """Return the mask (s,) of all sensors."""
    return np.ones(plant.rows.sensors, dtype=np.bool_)


def slow_pair(plant: Plant, step: StepMatrices, bandwidth_1_s: float) -> SlowPair:
    """Split off the modes slower than the bandwidth, with the heats; the sources' lags always stay.

    Args:
        plant: The model.
        step: Matrices of the step.
        bandwidth_1_s: Decay rate below which a mode is moved, 1/s. Infinite moves all modes.
    """
    Ad, _ = design_step(plant, step)
    n_x = len(plant.decay_1_s)
    heats = np.arange(n_x, len(Ad))
    mode = np.ones(n_x, dtype=np.bool_)
    mode[plant.lag_slice] = False
    slow = np.flatnonzero(mode & (plant.decay_1_s < bandwidth_1_s))
    fast = np.setdiff1d(np.arange(n_x), slow)
    V = Ad[np.ix_(fast, heats)] / (step.heat_decay - step.decay[fast, None])
    retained = np.concatenate([slow, heats])
    C = plant.rows.C[plant.rows.sensor_slice]
    scale = np.concatenate([np.sqrt(np.diag(plant.prior_P))[slow], plant.initial_sigma_W])
    return SlowPair(
        slow=slow,
        fast=fast,
        A=Ad[np.ix_(retained, retained)],
        C=np.hstack([C[:, slow], C[:, fast] @ V]),
        V=V,
        scale=np.where(scale > 0, scale, 1.0),
    )


def lift(pair: SlowPair, K_slow: FloatArray, present: BoolArray) -> FloatArray:
    """Return the gain in the plant's own states: K_fast = V K_heat, so the fast poles stay.

    Args:
        pair: The slow pair.
        K_slow: Its gain, (n_s, number of present sensors).
        present: True for the sensors that are present, (s,).

    Returns:
        K (n, s), with zero columns for absent sensors.
    """
    heats = len(pair.V[0])
    n = len(pair.slow) + len(pair.fast) + heats
    K = np.zeros((n, len(present)))
    K_heat = K_slow[len(pair.slow) :]
    K[np.ix_(pair.slow, present)] = K_slow[: len(pair.slow)]
    K[np.ix_(pair.fast, present)] = pair.V @ K_heat
    K[n - heats :, present] = K_heat
    return K


def bandwidth_poles(count: int, bandwidth_1_s: float, dt_s: float) -> FloatArray:
    """Return distinct poles around -ω, 1/s: -ω (1, 1.15, 1.3, …).

    Args:
        count: Number of poles.
        bandwidth_1_s: The rate ω, 1/s; at most 2/dt is used, so that no pole lies at z = 0.
        dt_s: Length of the step, s; 0 sets no limit.
    """
    omega = bandwidth_1_s if dt_s == 0 else min(bandwidth_1_s, _FASTEST_PER_STEP / dt_s)
    return np.asarray(-omega * (1.0 + _SPREAD * np.arange(count)))


def design_bandwidth(
    plant: Plant, step: StepMatrices, present: BoolArray, bandwidth_1_s: float
) -> LuenbergerGain | Refusal:
    """Place the slow part of the pair around the bandwidth, on the rows of the sensors that are present.

    Source: Kautsky, Nichols and Van Dooren (1985); Tits and Yang (1996), as `scipy.signal.place_poles`.

    Args:
        plant: The model. Constant couplings are treated in its own modes.
        step: Matrices of the step.
        present: True for the sensors that are present, (s,).
        bandwidth_1_s: Rate of the placed poles, 1/s.

    Returns:
        The gain. A refusal if the heats are not determinable, if no gain places the poles, or if they are
        missed by more than `POLE_TOLERANCE`.
    """
    n_x, V = len(plant.decay_1_s), None
    if len(plant.coupling.links.source):
        plant, V = frozen(plant)
        step = step_matrices(plant, step.dt_s)
    pair = slow_pair(plant, step, bandwidth_1_s)
    if not determinable(pair, present):
        return refusal(plant, present, "they cannot distinguish the heats from each other and from the field")
    poles = bandwidth_poles(len(pair.A), bandwidth_1_s, step.dt_s)
    try:
        K_slow = _place(pair, plant, present, np.exp(poles * step.dt_s))
    except (ValueError, np.linalg.LinAlgError):
        return refusal(plant, present, "no gain places the poles")
    gain = finish(plant, step, pair, K_slow, present, poles)
    if isinstance(gain, Refusal):
        return gain
    if not gain.pole_error <= POLE_TOLERANCE:
        return refusal(plant, present, f"the poles reached are {gain.pole_error:.0%} off")
    return gain if V is None else gain._replace(K=np.vstack([V @ gain.K[:n_x], gain.K[n_x:]]))


def determinable(pair: SlowPair, present: BoolArray) -> bool:
    """Return whether constant heats leave a trace in the sensors that are present.

    The test is that [[A - I], [C]] of the slow pair has full rank. Source: Davison and Smith (1971). Rows are
    scaled to the priors so that the rank has a meaning.

    Args:
        pair: The slow pair.
        present: True for the sensors that are present, (s,).
    """
    matrix = np.vstack([pair.A - np.eye(len(pair.A)), pair.C[present]]) * pair.scale
    norms = np.linalg.norm(matrix, axis=1, keepdims=True)
    matrix = matrix / np.where(norms > 0, norms, 1.0)
    return bool(np.linalg.matrix_rank(matrix, tol=1e-9) == len(pair.A))


def noise_gain(M: FloatArray, K: FloatArray, heats: int) -> FloatArray:
    """Return each heat's steady σ under white noise of 1 K on each sensor, W/K.

    The covariance solves Σ = M Σ Mᵀ + K Kᵀ with M = (I - K C) Ad.

    Args:
        M: Closed loop, (n, n); its last states are the heats.
        K: Gain, (n, s).
        heats: Number m_e of heats.

    Returns:
        σ (m_e,), infinite where the loop is unstable. Where double precision cannot give Σ, a lower bound:
        the norm of each heat's row of K.
    """
    if not is_stable(M):
        return np.full(heats, np.inf)
    Sigma = accumulated(M, K @ K.T)
    if Sigma is None:
        return np.asarray(np.linalg.norm(K[-heats:], axis=1))
    return np.sqrt(np.diag(Sigma)[-heats:])


def accumulated(M: FloatArray, Q: FloatArray) -> FloatArray | None:
    """Return Σ = M Σ Mᵀ + Q of a stable M (n, n), or None where double precision cannot give it.

    Each doubling sums twice as many steps: Σ ← Σ + M Σ Mᵀ, M ← M². No equation is solved, so no variance
    turns negative by an ill-conditioned matrix. Source: Smith (1968), SIAM J. Appl. Math. 16, 198-201.

    Args:
        M: Transition, (n, n), with all eigenvalues inside the unit circle.
        Q: Covariance that each step adds, (n, n).

    Returns:
        Σ (n, n), symmetric. None after an overflow, with a negative variance, or with a relative residual
        above 1e-6.
    """
    Sigma, power = Q, M
    try:
        with np.errstate(over="raise", invalid="raise"):
            for _ in range(_DOUBLINGS):
                Sigma = Sigma + power @ Sigma @ power.T
                if np.abs(power).max() < _ROUNDING:
                    break
                power = power @ power
            residual = np.abs(M @ Sigma @ M.T + Q - Sigma).max()
    except FloatingPointError:
        return None
    if not residual <= _BELIEVED * np.abs(Sigma).max() or np.any(np.diag(Sigma) < 0.0):
        return None
    return 0.5 * (Sigma + Sigma.T)


def is_stable(M: FloatArray) -> bool:
    """Whether every eigenvalue lies inside the unit circle, by more than rounding."""
    return bool(np.max(np.abs(eigvals(M))) < 1.0 - _ROUNDING)


def closed_loop(plant: Plant, step: StepMatrices, K: FloatArray) -> FloatArray:
    """Return (I - K C) Ad, (n, n), the transition of the estimate's error over a step.

    Args:
        plant: The model.
        step: Matrices of the step, with Ad of [x | δ].
        K: Gain, (n, s).
    """
    Ad, _ = design_step(plant, step)
    C = sensor_rows(plant)
    return Ad - K @ (C @ Ad)


def sensor_rows(plant: Plant) -> FloatArray:
    """Return the rows (s, n) of the sensors on the augmented state [x | δ]; those of the heats are zero."""
    C = plant.rows.C[plant.rows.sensor_slice]
    return np.hstack([C, np.zeros((len(C), int(plant.estimated.sum())))])


def poles_of(M: FloatArray, dt_s: float) -> ComplexArray:
    """Return the continuous poles log(eig M)/dt, 1/s, the slowest first; real where they are real.

    Args:
        M: Transition over a step, (n, n). An eigenvalue of 0 counts as the smallest positive number.
        dt_s: Length of the step, s.
    """
    z = eigvals(M).astype(np.complex128)
    z = np.where(z == 0, np.finfo(float).tiny, z)
    p = np.log(z) / dt_s
    return np.asarray(p[np.argsort(-p.real, kind="stable")], dtype=np.complex128)


def pole_error(requested_1_s: FloatArray, reached_1_s: ComplexArray) -> float:
    """Return the largest relative distance between requested and reached poles.

    Args:
        requested_1_s: Requested poles, 1/s, (k,).
        reached_1_s: Reached poles, 1/s, at least k. They are matched one to one with the smallest sum of
            distances.

    Returns:
        The distance relative to the requested pole; infinite if a distance is not finite.
    """
    cost = np.abs(requested_1_s[:, None] - reached_1_s[None, :]) / np.abs(requested_1_s)[:, None]
    if not np.isfinite(cost).all():
        return float("inf")
    rows, columns = linear_sum_assignment(cost)
    return float(cost[rows, columns].max())


def _place(pair: SlowPair, plant: Plant, present: BoolArray, z: FloatArray) -> FloatArray:
    """Return the gain (n_s, present) of the slow pair, computed in coordinates scaled to the priors."""
    sigma_K = np.sqrt(plant.noise_R_K2[present])
    A = pair.A * pair.scale / pair.scale[:, None]
    CA = (pair.C[present] * pair.scale / sigma_K[:, None]) @ A
    return np.asarray(pair.scale[:, None] * _placed(A, CA, z).T / sigma_K)


@cached(256)
def _placed(A: FloatArray, CA: FloatArray, z: FloatArray) -> FloatArray:
    """Return the gain (rows of CA, n_s) in the scaled coordinates; cached for search, report and loop."""
    from scipy.signal import place_poles  # noqa: PLC0415  (start-up: only this estimator needs it)

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # where it is not optimal; the poles reached are checked by us
        placed = place_poles(A.T, CA.T, z, method="YT", rtol=1e-2, maxiter=_ITERATIONS)
    return np.asarray(placed.gain_matrix)


def finish(
    plant: Plant,
    step: StepMatrices,
    pair: SlowPair,
    K_slow: FloatArray,
    present: BoolArray,
    poles: FloatArray,
) -> LuenbergerGain | Refusal:
    """Return a gain of the slow pair as a gain of the plant's states, with its poles and noise gain.

    Args:
        plant: The model.
        step: Matrices of the step.
        pair: The slow pair.
        K_slow: Its gain, (n_s, number of present sensors).
        present: True for the sensors that are present, (s,).
        poles: Poles requested of the slow pair, 1/s, (n_s,).

    Returns:
        The gain, or a refusal if `K_slow` is not finite.
    """
    if not np.isfinite(K_slow).all():
        return refusal(plant, present, "a mode of the model has a node at the sensor")
    K = lift(pair, K_slow, present)
    M_slow = pair.A - K_slow @ (pair.C[present] @ pair.A)
    reached = poles_of(closed_loop(plant, step, K), step.dt_s)
    visible = plant.decay_1_s[pair.fast] * step.dt_s < -np.log(_NEGLIGIBLE_Z)
    requested = np.sort(np.concatenate([-plant.decay_1_s[pair.fast][visible], poles]))[::-1]
    return LuenbergerGain(
        K=K,
        poles_requested_1_s=requested,
        poles_reached_1_s=reached[: len(requested)],
        noise_gain_W_K=noise_gain(M_slow, K_slow, len(pair.V[0])),
    )


def design_kim(plant: Plant, step: StepMatrices, present: BoolArray) -> LuenbergerGain | Refusal:
    """Place all modes and the heat by Kim's rule (27), for one sensor and one heat; lags stay.

    Args:
        plant: A screw alone, without constant couplings.
        step: Matrices of the step.
        present: True if the sensor is present, (1,).

    Returns:
        The gain. A refusal for other sensors, heats or plants, or if a mode has a node at the sensor or
        decays within one step.
    """
    if len(present) != 1 or plant.estimated.sum() != 1:
        return refusal(plant, present, "Kim's rule is for one sensor and one estimated heat")
    if not present[0]:
        return refusal(plant, present, "without the sensor there is nothing to correct by")
    if not plant.by_itself:
        return refusal(plant, present, "Kim's rule is for a screw by itself")
    pair = slow_pair(plant, step, np.inf)
    poles = kim_poles(plant.decay_1_s[: plant.modes], plant.diffusion_rate_1_s)
    try:
        with np.errstate(divide="raise", over="raise", invalid="raise"):
            K_slow = _single_output(pair, np.exp(poles * step.dt_s))
            return finish(plant, step, pair, K_slow, present, poles)
    except FloatingPointError:
        return refusal(
            plant, present, "a mode of the model has a node at the sensor, or decays within one step"
        )


def kim_poles(decay_1_s: FloatArray, diffusion_rate_1_s: float) -> FloatArray:
    """Return the N + 1 poles of rule (27), 1/s: -(3 Λ_N + i) for i = 0 … N, in dimensionless time τ = α t/L².

    The rule adds steps of 1 to a rate, so it only means something where rates have no unit. Source: Kim,
    equation (27).

    Args:
        decay_1_s: Decay rates Λ of the modes, 1/s, (N,).
        diffusion_rate_1_s: α/L², 1/s.
    """
    fastest = 3.0 * float(np.max(decay_1_s)) / diffusion_rate_1_s
    return np.asarray(-(fastest + np.arange(len(decay_1_s) + 1)) * diffusion_rate_1_s)


def _single_output(pair: SlowPair, z: FloatArray) -> FloatArray:
    """Gain (n_s, 1) for one sensor and one heat by the closed form, in the eigenvectors of A."""
    N = len(pair.slow)
    e, gamma, G = np.diag(pair.A)[:N], float(pair.A[N, N]), pair.A[:N, N]
    c = pair.C[0, :N]
    chained = np.flatnonzero(e == gamma)
    order = np.concatenate([chained, np.setdiff1d(np.arange(N), chained)])
    free = order[len(chained) :]
    v = np.zeros(N)
    v[free] = G[free] / (gamma - e[free])
    if len(chained) == 0:
        c_heat = pair.C[0, N] + c @ v
        g = gains_on_eigenvectors(np.append(e, gamma), np.append(c * e, c_heat * gamma), z)
        modes, heat = g[:N], float(g[N])
    else:
        first = int(chained[0])
        c_heat = (pair.C[0, N] + c @ v) * gamma + c[first] * G[first]
        modes = np.empty(N)
        modes[order], heat = gains_on_chain(e[order], c[order] * e[order], float(G[first]), c_heat, z)
    return np.append(modes + v * heat, heat)[:, None]


def gains_on_eigenvectors(eigenvalues: FloatArray, c: FloatArray, poles: FloatArray) -> FloatArray:
    """Return the gains g for which diag(λ) - g c has the requested poles.

    g_i = Π_j (λ_i - p_j) / (c_i Π_{j≠i} (λ_i - λ_j)). Factors are multiplied in pairs, so that nothing
    overflows on the way.

    Args:
        eigenvalues: Distinct eigenvalues λ, (n,).
        c: Row of the output, (n,), without zeros.
        poles: Requested poles p, (n,).

    Returns:
        g (n,). It is infinite or NaN, with a numpy warning, where eigenvalues coincide or c is 0.
    """
    g = np.empty(len(eigenvalues))
    for i, eigenvalue in enumerate(eigenvalues):
        others = np.delete(np.arange(len(eigenvalues)), i)
        ratios = (eigenvalue - poles[others]) / (eigenvalue - eigenvalues[others])
        g[i] = (eigenvalue - poles[i]) / c[i] * np.prod(ratios)
    return g


def gains_on_chain(
    eigenvalues: FloatArray, c: FloatArray, coupling: float, c_heat: float, poles: FloatArray
) -> tuple[FloatArray, float]:
    """Return the gains of modes and heat where the heat's eigenvalue is also that of the first mode.

    An insulated screw without surface loss only warms, so its first mode and the heat form a chain [[λ_1,
    coupling], [0, λ_1]]: a double pole. With h(z) = Π(z - p_j)/Π_{i>1}(z - λ_i) the residues at λ_1 are h and
    h'.

    Args:
        eigenvalues: Eigenvalues of the modes, (N,), the shared one first.
        c: Row of the output on the modes, (N,).
        coupling: Effect of the heat on the first mode over a step.
        c_heat: Output of the heat after the other modes are decoupled from it.
        poles: Requested poles, (N + 1,).

    Returns:
        Gains of the modes, (N,), and of the heat.
    """
    first_eigenvalue, others = eigenvalues[0], eigenvalues[1:]
    residue = float(
        np.prod((first_eigenvalue - poles[: len(others)]) / (first_eigenvalue - others))
        * np.prod(first_eigenvalue - poles[len(others) :])
    )
    slope = residue * (np.sum(1.0 / (first_eigenvalue - poles)) - np.sum(1.0 / (first_eigenvalue - others)))
    heat = residue / (c[0] * coupling)
    g = np.empty(len(eigenvalues))
    g[0] = (slope - c_heat * heat) / c[0]
    for i in range(1, len(eigenvalues)):
        rest = np.delete(np.arange(1, len(eigenvalues)), i - 1)
        value = eigenvalues[i]
        ratios = (value - poles[: len(rest)]) / (value - eigenvalues[rest])
        top = np.prod(ratios) * np.prod(value - poles[len(rest) :])
        g[i] = top / (c[i] * (value - first_eigenvalue) ** 2)
    return g, heat
