"""The plant of every estimator: modes, lags and heats in one linear form.

States x = [modal amplitudes η of the temperature | one lag r_j per source], in continuous time

    dx/dt = -decay ∘ x + B q + E z,      T(x) = C x + F z,

with heats q in W (one per source) and known inputs z (ambient, prescribed ends, the error's reference). The
lag r_j follows q_j with the decay rate of the first dropped mode; its output column is the steady response
of all dropped modes. So no heat acts at once, and the field at rest is exact with any number of modes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from observer.frames import BoolArray, FloatArray, Layout
from observer.model.coupling import Coupling
from observer.model.learning import Learning, LearningArrays, Nuisance, learning_of
from observer.model.rod.moving import NutTable
from observer.model.rod.supports import Restraint, fold, tension

OFFSET = "offset."
"""Prefix of a known input that is a sensor's offset, before the sensor's name."""


START_SHARE = 1.0 / 3.0
"""Part of the uncertainty of friction that differs between starts; the rest is one factor."""
AMBIENT, LEFT, RIGHT, BED, REFERENCE = "ambient", "left", "right", "bed", "reference"
"""The names of the other known inputs: the ambient, the prescribed ends, a bed that is measured, the thermal
error's reference.
"""


class KnownColumns(NamedTuple):
    """Columns of the known inputs z, None if absent.

    Attributes:
        ambient: Column of the ambient.
        left_end: Column of a prescribed left end.
        right_end: Column of a prescribed right end.
        reference: Column of the thermal error's reference.
        offset: True for the columns of sensors' offsets, (p,).
    """

    ambient: int
    left_end: int | None
    right_end: int | None
    reference: int | None
    offset: BoolArray

    @classmethod
    def of(cls, names: Sequence[str]) -> KnownColumns:
        """Return the columns by the names of the known inputs (p,).

        Raises:
            KeyError: If the ambient is not among them.
        """
        at = {name: q for q, name in enumerate(names)}
        offset = np.array([name.startswith(OFFSET) for name in names], dtype=np.bool_)
        return cls(at[AMBIENT], at.get(LEFT), at.get(RIGHT), at.get(REFERENCE), offset)


class Following(NamedTuple):
    """A source without an unknown of its own.

    Attributes:
        source: Its number.
        owner: Number of the source that it follows.
        part: Its heat relative to the owner's.
    """

    source: int
    owner: int
    part: float


class Basis(NamedTuple):
    """The states ξ of a plant in its own modes: x = V ξ.

    Attributes:
        V: The modes, (n_x, n_x).
        inverse: Inverse of V, (n_x, n_x).
        decay_1_s: Decay rates of the uncoupled x (modes, lags, nodes, lagging sensors), (n_x,).
    """

    V: FloatArray
    inverse: FloatArray
    decay_1_s: FloatArray


@dataclass(frozen=True, slots=True)
class OutputRows:
    """Output rows; temperatures in °C, errors in µm.

    Rows 0 … s-1 are the sensors, then g rows of the field on the grid, then those of the thermal error. The
    error has no rows without an expansion coefficient, and g rows with one. If `restraint` has a clearance,
    it has 2 g + 1 rows, from which `supports.fold` makes g.

    Attributes:
        C: Rows of the states, (R, n_x).
        F: Rows of the known inputs, (R, p).
        sensors: Number s of sensors.
        grid: Number g of grid points.
        restraint: Supports of the screw; None for a free one.
    """

    C: FloatArray
    F: FloatArray
    sensors: int
    grid: int
    restraint: Restraint | None = None

    @property
    def sensor_slice(self) -> slice:
        """The sensors' rows."""
        return slice(0, self.sensors)

    @property
    def field_slice(self) -> slice:
        """The field's rows."""
        return slice(self.sensors, self.sensors + self.grid)

    @property
    def error_slice(self) -> slice:
        """The thermal error's rows; empty without an expansion coefficient."""
        return slice(self.sensors + self.grid, len(self.C))

    def error_um(self, values: FloatArray) -> FloatArray:
        """Return the thermal error between supports, µm, (K, g).

        Args:
            values: Values of all rows, (K, R).
        """
        rows = values[:, self.error_slice]
        return fold(self.restraint, rows, np.zeros_like(rows))[0]

    def force_N(self, values: FloatArray) -> FloatArray:
        """Return the axial force, N, tension positive, (K, 1); (K, 0) without a support at each end.

        Args:
            values: Values of all rows, (K, R).
        """
        rows = values[:, self.error_slice]
        return tension(self.restraint, rows, np.zeros_like(rows))[0]


@dataclass(frozen=True, slots=True)
class MovingSource:
    """A source whose footprint follows a position channel.

    Attributes:
        index: Its column in B.
        channel: Its position channel.
        table: Data for the averages of its columns over a path.
        ends_fraction: The share of the heat that enters at the reversals.
        reach_m: Its stroke; None if that is the whole screw.
    """

    index: int
    channel: str
    table: NutTable
    ends_fraction: float
    reach_m: tuple[float, float] | None = None

    def with_table(self, **parts: FloatArray) -> MovingSource:
        """Return the source with other parts of its table."""
        return replace(self, table=replace(self.table, **parts))  # type: ignore[arg-type]


@dataclass(frozen=True, slots=True)
class Plant:
    """A continuous-time plant with its output rows and the prior of its state.

    The estimated heats deviate from their laws by δ: dδ = -heat_decay δ dt + random walk, and a step of
    `jump_uncertainty` × the law's own jump. Sources that follow another have zero columns: the other's column
    includes theirs.

    Attributes:
        layout: Names and places of the outputs.
        decay_1_s: Decay rates of the states, (n_x,).
        B: Input columns of the heats, (n_x, m).
        E: Input columns of the known inputs, (n_x, p).
        rows: Output rows.
        moving: Sources that follow a position channel.
        uniform: The state of a screw at 1 °C everywhere, (n_x,).
        prior_P: Covariance of the unknown field at the start, K², (n_x, n_x).
        smooth_P: Covariance of its smooth part, K², (n_x, n_x).
        noise_R_K2: Variances of the sensors, (s,).
        thermal: True for sensors of temperature, False for sensors of displacement in µm, (s,).
        estimated: True for estimated heats, (m,).
        random_walk_W2_s: Random walk of δ, (m_e,).
        heat_decay_1_s: Decay rate of δ, (m_e,).
        law_uncertainty: Relative σ of the laws, (m_e,).
        initial_sigma_W: σ of δ at the start, (m_e,).
        field_noise_Q: Optional noise on the field, K²/s, (n_x, n_x).
        mode_index: Numbers of the modes, counted from 1, (N,); those that bend under nuts come last.
        bent: Number of the modes that bend under nuts.
        diffusion_rate_1_s: α/L², one over the unit of dimensionless time.
        dropped_rate_1_s: Decay rate of the slowest dropped mode.
        coupling: Time-varying couplings of the states.
        learning: The uncertain parameters; None if all are exact.
        basis: The plant's own modes; None if the states are modes of the screw, lags and nodes.
        following: Sources that follow another.
        by_speed: Numbers of the sources whose law is friction.
    """

    layout: Layout
    decay_1_s: FloatArray
    B: FloatArray
    E: FloatArray
    rows: OutputRows
    moving: tuple[MovingSource, ...]
    uniform: FloatArray
    prior_P: FloatArray
    smooth_P: FloatArray
    noise_R_K2: FloatArray
    thermal: BoolArray
    estimated: BoolArray
    random_walk_W2_s: FloatArray
    heat_decay_1_s: FloatArray
    law_uncertainty: FloatArray
    initial_sigma_W: FloatArray
    field_noise_Q: FloatArray
    mode_index: tuple[int, ...]
    source_names: tuple[str, ...]
    known_names: tuple[str, ...]
    diffusion_rate_1_s: float
    dropped_rate_1_s: float
    coupling: Coupling
    bent: int = 0
    learning: Learning | None = None
    basis: Basis | None = None
    following: tuple[Following, ...] = ()
    by_speed: tuple[int, ...] = ()

    def of_screw(self, columns: FloatArray) -> FloatArray:
        """Return the states for modal amplitudes of the screw, (…, n_x).

        Args:
            columns: Modal amplitudes, (…, N).
        """
        if self.basis is None:
            wide = [(0, 0)] * (columns.ndim - 1) + [(0, len(self.decay_1_s) - self.modes)]
            return np.pad(columns, wide)
        return np.asarray(columns @ self.basis.inverse[:, : self.modes].T)

    @property
    def by_itself(self) -> bool:
        """Whether the plant has no constant couplings: it is the screw alone."""
        return self.basis is None and not len(self.coupling.links.source)

    @property
    def lags(self) -> FloatArray:
        """The states (m, n_x) of each source's lag at 1 W."""
        inverse = np.eye(len(self.decay_1_s)) if self.basis is None else self.basis.inverse
        return inverse[:, self.lag_slice].T

    @property
    def lag_rows(self) -> FloatArray:
        """The rows (m, n_x) that read the sources' lags."""
        V = np.eye(len(self.decay_1_s)) if self.basis is None else self.basis.V
        return V[self.lag_slice]

    @property
    def learnt(self) -> int:
        """Number L of an estimator's states for uncertain parameters, considered ones included."""
        return 0 if self.learning is None else len(self.learning.arrays.kind)

    @property
    def parameters(self) -> LearningArrays:
        """The uncertain parameters as arrays, which may be empty."""
        if self.learning is not None:
            return self.learning.arrays
        return learning_of((), (), len(self.decay_1_s), len(self.known_names)).arrays

    def with_parameters(self, arrays: LearningArrays) -> Plant:
        """Return the plant with other uncertain parameters, of which none is reported."""
        if self.learning is None:
            return self
        empty = np.zeros(0)
        learning = Learning(arrays, (), np.zeros(0, np.int64), empty, empty, self.learning.wander_s)
        return replace(self, learning=learning, layout=replace(self.layout, learned=()))

    @property
    def jump_uncertainty(self) -> FloatArray:
        """The standard deviation of a heat's step beside its law's, relative to the latter, (m_e,).

        It is the uncertainty of the law. If the scale of a law of the speed is learnt, it is only the
        difference between starts.
        """
        learned_scale = self.parameters.of[self.parameters.kind == Nuisance.LAW]
        has_scale = np.isin(np.arange(len(self.law_uncertainty)), learned_scale)
        is_constant = np.isin(np.flatnonzero(self.estimated), self.by_speed)
        return np.where(has_scale & is_constant, START_SHARE, 1.0) * self.law_uncertainty

    @property
    def lag_slice(self) -> slice:
        """The sources' lags among the states; couplings may add states after them."""
        return slice(self.modes, self.modes + len(self.source_names))

    def sensors_only(self) -> Plant:
        """Return the plant with its sensors' rows alone; its inputs are cut by `Inputs.sensors_only`."""
        s = self.rows.sensors
        moving = tuple(
            m.with_table(
                table_C=np.ascontiguousarray(m.table.table_C[:, :s]), mean_C=m.table.mean_C[:s].copy()
            )
            for m in self.moving
        )
        return replace(self, rows=OutputRows(self.rows.C[:s], self.rows.F[:s], s, 0), moving=moving)

    @property
    def known(self) -> KnownColumns:
        """The columns of the known inputs."""
        return KnownColumns.of(self.known_names)

    @property
    def modes(self) -> int:
        """The number of modes; the sources' lags come after them."""
        return len(self.mode_index)
