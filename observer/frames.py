"""The frozen records that flow through the program: reading → frame → inputs → estimate.

A reading is what a driver delivers, a frame is what the estimator's clock makes of all readings since its
last tick, an estimate is what goes to subscribers. Frames and estimates come in blocks of K steps with a
leading axis. The live service runs blocks of one step, a replay runs blocks of thousands. Both run through
the same compiled code, so both give the same bits.
"""

from __future__ import annotations

import enum
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]
QualityArray = NDArray[np.int8]


def contiguous(array: Any, dtype: Any = np.float64) -> Any:
    """Return an array in the one layout that compiled code takes: contiguous, writeable, of the given
    type.

    An array that has it is not copied.
    """
    array = np.ascontiguousarray(array, dtype)
    return array if array.flags.writeable else array.copy()


class _Labelled(enum.IntEnum):
    @property
    def label(self) -> str:
        """The lower-case name used in logs and messages."""
        return self.name.lower()


class Quality(_Labelled):
    """Quality of one channel's value; each part that passes it on can only lower it."""

    GOOD = 0
    MISSING = 1
    STALE = 2
    REJECTED = 3
    EXCLUDED = 4


class EstimateQuality(_Labelled):
    """Quality of a whole estimate, the better before the worse."""

    GOOD = 0
    STARTING = 1
    DEGRADED = 2
    STALE = 3
    INVALID = 4


class NutPath(NamedTuple):
    """All n samples of one position channel in K frames.

    Attributes:
        time_s: When the nut was there, (n,), s.
        position_m: Where it was, (n,).
        offset: The samples of step k are `[offset[k]:offset[k+1]]`, the newest last, (K+1,).
        driven_m_s: The screw's speed times its lead at that time, (n,), NaN where unknown.
        speed_age_s: How much older the reading of that speed was, (n,).
    """

    time_s: FloatArray
    position_m: FloatArray
    offset: NDArray[np.int64]
    driven_m_s: FloatArray
    speed_age_s: FloatArray


@dataclass(frozen=True, slots=True)
class Reading:
    """One driver's reading at one moment.

    Attributes:
        time_s: That moment as far as it is known, not the time of processing, s since 1970.
        values: Values by channel, in the unit that ends the channel's name; NaN for one that cannot be used.
        faults: The reason of each NaN ("open_circuit", "over_range", "timeout", …) by channel.
        late_s: For a row of a recording, in the order of use: how long before `time_s` it was true.
    """

    time_s: float
    values: Mapping[str, float]
    faults: Mapping[str, str] = field(default_factory=dict)
    late_s: float = 0.0


class _Cut:
    """A block that may be given its columns in one piece, as `kept`: each is cut out when it is asked for.

    `kept` is their layout, which has a method `column(data, name)`, and the data.
    """

    __slots__ = ("kept",)
    kept: tuple[Any, bytes]

    @classmethod
    def of(cls, views: Any, data: bytes) -> Self:
        """Return the block whose columns these data are."""
        block = _new(cls)
        _keep(block, (views, data))
        return block

    if not TYPE_CHECKING:  # only the columns are found so

        def __getattr__(self, name: str) -> Any:
            if name not in type(self).__dataclass_fields__:
                raise AttributeError(f"{type(self).__name__} has no {name}", name=name, obj=self)
            views, data = self.kept
            column = views.column(data, name)
            object.__setattr__(self, name, column)
            return column


_new, _keep = object.__new__, _Cut.kept.__set__  # type: ignore[attr-defined, misc]


@dataclass(frozen=True, slots=True)
class FrameBlock(_Cut):
    """K frames: every channel's latest value and quality at each tick of the estimator.

    A value that is not fresh is the last usable one (NaN before the first) and is never used twice as a
    measurement. Between two ticks a fast channel may deliver several samples. Those of the position channels
    are kept in `path`.

    Attributes:
        channels: Names of the c channels.
        time_s: Time of each tick, (K,), s since 1970 or since the log's zero.
        dt_s: Time since the tick before, (K,); 0 at the first frame of a run.
        values: Latest values (K, c), in the channels' units.
        fresh: Whether a usable value arrived since the tick before, (K, c).
        quality: Codes of `Quality`, (K, c).
        age_s: Age of the latest values, (K, c); infinite before the first.
        path: The samples of each position channel.
    """

    channels: tuple[str, ...]
    time_s: FloatArray
    dt_s: FloatArray
    values: FloatArray
    fresh: BoolArray
    quality: QualityArray
    age_s: FloatArray
    path: Mapping[str, NutPath]

    def __len__(self) -> int:
        return len(self.time_s)

    @property
    def shown_quality(self) -> QualityArray:
        """The quality (K, c) for people: an occasional channel without any value yet has no fault, but is
        missing.
        """
        never = np.isinf(self.age_s) & (self.quality == Quality.GOOD)
        return np.where(never, np.int8(Quality.MISSING), self.quality)


class _InputColumns(NamedTuple):
    """The columns of `Inputs`."""

    time_s: FloatArray
    dt_s: FloatArray
    y_degC: FloatArray
    usable: BoolArray
    quality: QualityArray
    law_W: FloatArray
    law_jump_W: FloatArray
    z_start: FloatArray
    z_end: FloatArray
    moving_B: FloatArray
    moving_C: FloatArray
    degraded: NDArray[np.int8]
    loss_1_s: FloatArray
    loss_degC: FloatArray


class Inputs(_InputColumns):
    """K steps of everything that drives a plant; the argument of an estimator's `run`.

    n_x states, m sources, p known inputs, s sensors, R output rows, M moving sources.

    Attributes:
        time_s: End of each step, (K,).
        dt_s: Its length, (K,).
        y_degC: Measurements (K, s), of a displacement in µm.
        usable: The measurements that may correct, (K, s).
        quality: Quality of each sensor before the estimator's own gate, (K, s).
        law_W: Each source's heat by its law, mean over the step, (K, m).
        law_jump_W: Its change since the step before, (K, m).
        z_start: The known inputs at the begin of the step, (K, p); linear in between.
        z_end: The known inputs at its end, (K, p).
        moving_B: The input column of each moving source over the step, (K, M, n_x).
        moving_C: The output column of its lag state, (K, M, R).
        degraded: 1 where a required input was missing or held, 2 where the place of a nut is unknown, (K,).
        loss_1_s: Rate of a uniform loss that goes with speed, (K,).
        loss_degC: The temperature that this loss draws to, (K,).
    """

    __slots__ = ()

    def __len__(self) -> int:
        return len(self.time_s)

    @classmethod
    def _make(cls, iterable: Iterable[Any]) -> Self:  # type: ignore[override]
        return tuple.__new__(cls, iterable)  # the inherited one takes `len` for the number of columns

    @classmethod
    def joined(cls, blocks: Sequence[Inputs]) -> Self:
        """Return consecutive blocks of one plant as one."""
        return cls._make(np.concatenate(column) for column in zip(*blocks, strict=True))

    @classmethod
    def empty(cls, sources: int, inputs: int, sensors: int, moving: int, states: int, rows: int) -> Self:
        """Return one step of zeros for a plant of these sizes.

        Args:
            sources: m.
            inputs: p.
            sensors: s.
            moving: M.
            states: n_x.
            rows: R.
        """
        one, laws, z = (1,), (1, sources), (1, inputs)
        y, B, C = (1, sensors), (1, moving, states), (1, moving, rows)
        return cls._make(map(np.zeros, (one, one, y, y, y, laws, laws, z, z, B, C, one, one, one), _KINDS))

    def part(self, begin: int, end: int | None = None) -> Self:
        """Return the steps from `begin` up to `end`, as views; None for `end` takes all that follow."""
        return self._make(column[begin:end] for column in self)

    def packed(self) -> Self:
        """Return the same steps in the one layout that compiled code takes; columns that have it are not
        copied.
        """
        return self._make(map(contiguous, self, _KINDS))

    def sensors_only(self, sensors: int) -> Self:
        """Return the same steps for a plant that is cut to its sensors' rows (`Plant.sensors_only`)."""
        return self._replace(moving_C=np.ascontiguousarray(self.moving_C[:, :, :sensors]))


_SMALL = {"usable": np.bool_, "quality": np.int8, "degraded": np.int8}
_KINDS = [_SMALL.get(name, np.float64) for name in Inputs._fields]


FORCE = ("force_N", "force_sigma_N", "force_bound_N")
"""The columns of the axial force, which only a screw that is held at both ends has."""


@dataclass(frozen=True, slots=True)
class Layout:
    """Names and places of an estimate's columns.

    Attributes:
        sources: Names of the m_e estimated sources.
        position_m: The grid, (g,).
        sensors: Names of the s sensors.
        has_error: Whether there is a thermal error, which needs an expansion coefficient.
        learned: Keys of the l learnt parameters.
        displacements: The sensors that measure displacements, whose innovations are in µm.
        has_force: Whether there is an axial force, as in a screw held at both ends.
    """

    sources: tuple[str, ...]
    position_m: FloatArray
    sensors: tuple[str, ...]
    has_error: bool
    learned: tuple[str, ...] = ()
    displacements: tuple[str, ...] = ()
    has_force: bool = False

    @property
    def units(self) -> tuple[str, ...]:
        """The unit of each sensor's innovation, `K` or `um`, (s,)."""
        return tuple("um" if name in self.displacements else "K" for name in self.sensors)

    def along(self, **tables: FloatArray) -> dict[str, FloatArray]:
        """Return values along the screw as columns, place by place.

        Args:
            tables: Values (K, g) by a name with `__` at the place of the position.

        Returns:
            Columns (K,): those of `field__degC` are called `field_0_degC`, `field_50_degC` …, by the position
                in mm.
        """
        return {
            name.replace("__", f"_{1000 * x_m:.10g}_"): values[:, j]
            for j, x_m in enumerate(self.position_m)
            for name, values in tables.items()
        }


SIGMAS_OF_95 = 1.96
"""Standard deviations that half of a 95 % interval has."""
PARTS = ("heat", "field", "error")
"""The parts of an estimate that each have a quality."""


@dataclass(frozen=True, slots=True)
class EstimateBlock(_Cut):
    """K estimates.

    m_e estimated sources, g grid points, s sensors, l learnt parameters. Bounds that are left out are filled
    with NaN, and qualities of parts with the estimate's quality.

    Attributes:
        time_s: Time of each step, (K,).
        heat_W: Heats (K, m_e).
        heat_sigma_W: Their standard deviations (K, m_e).
        field_degC: Temperatures (K, g).
        field_sigma_K: Their standard deviations (K, g).
        error_um: Thermal error (K, g), or (K, 0) without an expansion coefficient.
        error_sigma_um: Its standard deviation, likewise.
        innovation_K: Innovations (K, s), of a displacement in µm; NaN where no value arrived.
        sensor_quality: Codes of `Quality`, (K, s).
        quality: Codes of `EstimateQuality`, of field and error, (K,).
        innovation_sigma_K: Standard deviations of the innovations (K, s).
        law_W: Each heat by its law at the present temperature, (K, m_e).
        learned: Learnt parameters (K, l), in the units of their keys.
        learned_sigma: Their standard deviations (K, l).
        heat_bound_W: Largest error of each heat (K, m_e), see `observer.estimators.bank`; NaN if unknown.
        field_bound_K: Largest error of each temperature (K, g), likewise.
        error_bound_um: Largest error of the thermal error, likewise.
        part_quality: Codes of `EstimateQuality` for each of `PARTS`, (K, 3).
        force_N: Axial force (K, 1), tension positive; (K, 0) unless the screw is held at both ends.
        force_sigma_N: Its standard deviation, likewise.
        force_bound_N: Its largest error, likewise.
    """

    time_s: FloatArray
    heat_W: FloatArray
    heat_sigma_W: FloatArray
    field_degC: FloatArray
    field_sigma_K: FloatArray
    error_um: FloatArray
    error_sigma_um: FloatArray
    innovation_K: FloatArray
    sensor_quality: QualityArray
    quality: QualityArray
    innovation_sigma_K: FloatArray
    law_W: FloatArray
    learned: FloatArray = field(default_factory=lambda: np.zeros((0, 0)))
    learned_sigma: FloatArray = field(default_factory=lambda: np.zeros((0, 0)))
    heat_bound_W: FloatArray = field(default_factory=lambda: np.zeros((0, 0)))
    field_bound_K: FloatArray = field(default_factory=lambda: np.zeros((0, 0)))
    error_bound_um: FloatArray = field(default_factory=lambda: np.zeros((0, 0)))
    part_quality: QualityArray = field(default_factory=lambda: np.zeros((0, 0), np.int8))
    force_N: FloatArray = field(default_factory=lambda: np.zeros((0, 0)))
    force_sigma_N: FloatArray = field(default_factory=lambda: np.zeros((0, 0)))
    force_bound_N: FloatArray = field(default_factory=lambda: np.zeros((0, 0)))

    def __post_init__(self) -> None:
        """Fill in NaN for bounds, the estimate's quality for that of its parts, and no force."""
        bounds = {
            "heat_bound_W": self.heat_W,
            "field_bound_K": self.field_degC,
            "error_bound_um": self.error_um,
        }
        for name, like in bounds.items():
            if not getattr(self, name).size:
                object.__setattr__(self, name, np.full(like.shape, np.nan))
        if not self.part_quality.size:
            parts = np.repeat(self.quality[:, None], len(PARTS), axis=1)
            object.__setattr__(self, "part_quality", parts)
        for name in FORCE:
            if not getattr(self, name).size:
                object.__setattr__(self, name, np.zeros((len(self.time_s), 0)))

    @property
    def error_quality(self) -> QualityArray:
        """The quality of the thermal error, (K,), of type `EstimateQuality`."""
        return self.part_quality[:, PARTS.index("error")]

    def error_known_to_um(self, grid_m: FloatArray, nut_m: float) -> FloatArray:
        """Return half of the 95 % interval of the thermal error at a place, (K,); NaN without an error.

        Args:
            grid_m: The grid (g,).
            nut_m: The place; NaN for the largest along the grid.
        """
        if not self.error_sigma_um.shape[1]:
            return np.full(len(self.time_s), np.nan)
        if math.isnan(nut_m):
            return np.asarray(SIGMAS_OF_95 * self.error_sigma_um.max(axis=1))
        there_um = [np.interp(nut_m, grid_m, sigma_um) for sigma_um in self.error_sigma_um]
        return SIGMAS_OF_95 * np.array(there_um)

    @property
    def used(self) -> BoolArray:
        """Whether each estimate uses each sensor, (K, s).

        A sensor is used while its reading is fresh and accepted and the sensor is not excluded. Between two
        samples of a slow sensor the last one counts. An invalid estimate uses none.
        """
        valid = self.quality != EstimateQuality.INVALID
        used: BoolArray = (self.sensor_quality == Quality.GOOD) & valid[:, None]
        return used

    @property
    def sensors_used(self) -> NDArray[np.int64]:
        """The number of sensors that each estimate uses, (K,)."""
        count: NDArray[np.int64] = self.used.sum(axis=1)
        return count

    @classmethod
    def joined(cls, blocks: Sequence[EstimateBlock]) -> Self:
        """Return consecutive blocks of one layout as one."""
        names = cls.__dataclass_fields__
        return cls(**{name: np.concatenate([getattr(block, name) for block in blocks]) for name in names})

    def __len__(self) -> int:
        return len(self.time_s)
