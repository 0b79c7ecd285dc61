"""The plant every estimator works on: modes, lags and heats in one linear form.

States x = [modal amplitudes η of the temperature | one lag r_j per source], in continuous time

    dx/dt = -decay ∘ x + B q + E z,      T(x) = C x + F z,

with heats q in W (one per source) and known inputs z (ambient, prescribed ends, the error's reference). The
lag r_j follows q_j with the decay rate of the first mode that was dropped; its output column is the steady
response of all dropped modes. So no heat acts at once, and the field at rest is exact with any number of
modes, unless a nut is coupled to a body.
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
"""How the name of a known input begins that is a sensor's offset; the sensor's name follows."""


START_SHARE = 1.0 / 3.0
"""That part of the uncertainty of friction differs from one start to the next; the rest is one factor."""
AMBIENT, LEFT, RIGHT, BED, REFERENCE = "ambient", "left", "right", "bed", "reference"
"""The names of the other known inputs: the ambient, the prescribed ends, a bed that is measured, the thermal
error's reference.
"""


class KnownColumns(NamedTuple):
    """Which column of the known inputs z is what, None what is not there; `offset` (p,), sensors' offsets."""

    ambient: int
    left_end: int | None
    right_end: int | None
    reference: int | None
    offset: BoolArray

    @classmethod
    def of(cls, names: Sequence[str]) -> KnownColumns:
        """Find them by the names (p,) of the columns."""
        at = {name: q for q, name in enumerate(names)}
        offset = np.array([name.startswith(OFFSET) for name in names], dtype=np.bool_)
        return cls(at[AMBIENT], at.get(LEFT), at.get(RIGHT), at.get(REFERENCE), offset)


class Following(NamedTuple):
    """The number of a `source` without an unknown of its own, and of the `owner` whose heat it is part of."""

    source: int
    owner: int
    part: float


class Basis(NamedTuple):
    """The states ξ of a plant in its own modes: x = `V` ξ, ξ = `inverse` x, both (n_x, n_x), with x its
    modes, lags, nodes and lagging sensors, which by themselves decay at `decay_1_s` (n_x,).
    """

    V: FloatArray
    inverse: FloatArray
    decay_1_s: FloatArray


@dataclass(frozen=True, slots=True)
class OutputRows:
    """Output rows: `C` (R, n_x) and `F` (R, p); temperatures in °C, errors in µm.

    Rows 0 … s-1 are the sensors, then g rows of the field on the grid, then those of the thermal error:
    none without an expansion coefficient, g of them, or, where `restraint` has a gap, the 2 g + 1 from which
    `supports.fold` makes g.
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
        """The thermal error (K, g) from the values (K, R) of all rows."""
        rows = values[:, self.error_slice]
        return fold(self.restraint, rows, np.zeros_like(rows))[0]

    def force_N(self, values: FloatArray) -> FloatArray:
        """The axial force (K, 1) from the values (K, R) of all rows; (K, 0) where both ends are not held."""
        rows = values[:, self.error_slice]
        return tension(self.restraint, rows, np.zeros_like(rows))[0]


@dataclass(frozen=True, slots=True)
class MovingSource:
    """A source whose footprint follows a position channel.

    `index` is its column in B; `table` holds what the averaging of its columns over a path needs. A share
    `ends_fraction` of the heat enters where the nut turns. `reach_m` is its stroke, None where that is the
    whole screw.
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

    Shapes: `decay_1_s` (n_x,); `B` (n_x, m); `E` (n_x, p); `uniform` (n_x,) the state of a screw at 1 °C
    everywhere; `prior_P` (n_x, n_x), K², the covariance of the unknown field at the start, and `smooth_P`
    that of its smooth part alone; `noise_R_K2` (s,) the sensors' variances, `thermal` (s,)
    which of them read a temperature, the others a displacement in µm; `estimated` (m,) which heats
    are estimated; `random_walk_W2_s` (m_e,), `heat_decay_1_s` (m_e,), `law_uncertainty` (m_e,),
    `initial_sigma_W` (m_e,) the estimated heats' deviation from their laws: dδ = -heat_decay δ dt + random
    walk, and a step of `jump_uncertainty` × the law's own jump; `field_noise_Q` (n_x, n_x), K²/s, optional
    noise on the field. `mode_index` (N,) are the numbers of the modes kept, counted from 1;
    `diffusion_rate_1_s` is α/L², one over the unit of dimensionless time, and `dropped_rate_1_s` that of the
    slowest mode that was dropped;
    `coupling` holds the time-varying couplings of the states, `learning` what is only roughly known,
    None where all is taken as the configuration says, and `basis` whose own modes the states are, None where
    they are the screw's and each lag and node by itself. The columns of sources `following` another are zero:
    theirs are in the other's, whose heat drives them all. `by_speed` are the sources whose law is friction.
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
    learning: Learning | None = None
    basis: Basis | None = None
    following: tuple[Following, ...] = ()
    by_speed: tuple[int, ...] = ()

    def of_screw(self, columns: FloatArray) -> FloatArray:
        """Return modal columns (…, N) of the screw as states (…, n_x)."""
        if self.basis is None:
            wide = [(0, 0)] * (columns.ndim - 1) + [(0, len(self.decay_1_s) - self.modes)]
            return np.pad(columns, wide)
        return np.asarray(columns @ self.basis.inverse[:, : self.modes].T)

    @property
    def by_itself(self) -> bool:
        """Whether nothing couples the states permanently: there is the screw alone."""
        return self.basis is None and not len(self.coupling.links.source)

    @property
    def lags(self) -> FloatArray:
        """What each source's lag at 1 W is of the states, (m, n_x)."""
        inverse = np.eye(len(self.decay_1_s)) if self.basis is None else self.basis.inverse
        return inverse[:, self.lag_slice].T

    @property
    def lag_rows(self) -> FloatArray:
        """The rows (m, n_x) that read the sources' lags."""
        V = np.eye(len(self.decay_1_s)) if self.basis is None else self.basis.V
        return V[self.lag_slice]

    @property
    def learnt(self) -> int:
        """How many states an estimator has for what is only roughly known."""
        return 0 if self.learning is None else len(self.learning.arrays.kind)

    @property
    def parameters(self) -> LearningArrays:
        """What is only roughly known, as arrays; of no parameter where that is nothing."""
        if self.learning is not None:
            return self.learning.arrays
        return learning_of((), (), len(self.decay_1_s), len(self.known_names)).arrays

    @property
    def jump_uncertainty(self) -> FloatArray:
        """The standard deviation of a heat's step beside the step of its law, in parts of the latter, (m_e,).

        It is that of the law. Where the scale of a law of the speed is learnt, it is only what differs from
        start to start.
        """
        learned_scale = self.parameters.of[self.parameters.kind == Nuisance.LAW]
        has_scale = np.isin(np.arange(len(self.law_uncertainty)), learned_scale)
        is_constant = np.isin(np.flatnonzero(self.estimated), self.by_speed)
        return np.where(has_scale & is_constant, START_SHARE, 1.0) * self.law_uncertainty

    @property
    def lag_slice(self) -> slice:
        """The sources' lags among the states; what couples states may have more after them."""
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
        """Which column of the known inputs is what."""
        return KnownColumns.of(self.known_names)

    @property
    def modes(self) -> int:
        """How many modes are kept; the states after them are the sources' lags."""
        return len(self.mode_index)
