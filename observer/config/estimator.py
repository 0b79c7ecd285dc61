"""The configuration's tables for estimation, tolerances, faults of sensors, and forecasts."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import AfterValidator, Field

from observer.config.outside import entry_names, is_outside, outside
from observer.config.quantities import Flag, NonNegative, Number, Positive, Rise, Section

Learnable = Literal[
    "convection", "conductivity", "heat_capacity", "ambient_K", "end_W_K", "law", "offset_K", "position_m",
    "lag_s", "link", "capacity", "gain", "division",
]  # fmt: skip
"""What an estimator may learn: the keys of `Tolerance`, and `law`, the scale of each heat's law."""

Relative = Annotated[NonNegative, Field(le=1)]


class Tolerance(Section):
    """One standard deviation of each quantity known only roughly; 0 takes the configured value as exact.

    A law's scale has its own, the source's `law_uncertainty`. Links, nodes and sensors may have their own,
    which replace the general ones here.
    """

    conductivity: Relative = 0.03  #: of the screw, relative
    heat_capacity: Relative = 0.03  #: density times specific heat, relative
    convection: Relative = 0.30  #: of the base film, relative
    ambient_K: Annotated[NonNegative, Field(le=50)] = 0.5  #: of the ambient temperature, measured or stated
    #: of the heat loss of each end beyond its boundary
    end_W_K: Annotated[NonNegative, Field(le=1000)] = 0.05
    position_m: Annotated[NonNegative, Field(le=1)] = 0.002  #: of each sensor's position on the screw
    offset_K: Annotated[NonNegative, Field(le=50)] = 0.3  #: of each sensor's offset
    lag_s: Annotated[NonNegative, Field(le=1000)] = 4.0  #: of each sensor's lag
    link: Relative = 0.2  #: of each link's conductance, relative
    capacity: Relative = 0.1  #: of each node's heat capacity, relative
    division: Relative = 0.1  #: of the share of a source's heat that enters its `nodes`
    #: of each sensor's gain on its rise above the air; in `calibrate`, `discover`, `identify`
    gain: Relative = 0.02
    heat_per_log: Relative = 0.03  #: of each source's heat between logs, relative; in `discover`

    def of_link(self, configured: float | None) -> float:
        """Return the relative tolerance of a link's conductance.

        Args:
            configured: The link's own, or None for the general one.
        """
        return self.link if configured is None else configured

    def of_capacity(self, configured: float | None) -> float:
        """Return the relative tolerance of a node's capacity.

        Args:
            configured: The node's own, or None for the general one.
        """
        return self.capacity if configured is None else configured


_KINDS = ("kalman", "luenberger")


def _known_kind(kind: str) -> str:
    if kind not in _KINDS:
        if not is_outside(kind, "estimators"):
            kinds = ", ".join((*_KINDS, *entry_names("estimators")))
            raise ValueError(f'unknown kind {kind[:60]!r}; give one of {kinds}, or "module:Class"')
        outside(kind, "estimators")
    return kind


class EstimatorSettings(Section):
    """How heats and field are estimated.

    Keys of another `kind` or `engine` have no effect. A `kind` from outside is imported when the
    configuration is read, and rejected if that fails.
    """

    #: `"kalman"`, `"luenberger"`, or a [class of your own](../how-to/add-an-estimator.md): `"module:Class"`
    #: or an entry point
    kind: Annotated[str, AfterValidator(_known_kind)] = "kalman"
    #: step of the live estimator; a replay steps with the rows of its log
    period_s: Annotated[Number, Field(ge=0.001, le=3600)] = 0.5
    # Kalman
    #: kalman: `"compiled"`, `"filterpy"` (slow, for comparison) or `"constant"` (steady-state gain)
    engine: Literal["compiled", "filterpy", "constant"] = "compiled"
    #: a measurement further than this from its prediction is rejected
    gate_sigma: Annotated[Positive, Field(ge=0.1)] = 5.0
    initial_sigma_K: Rise = 2.0  #: σ of the unknown field at the start
    #: random walk of the field beyond the sources: K after 1 s, grows with √t; 0 takes the model as exact
    field_noise_K_sqrt_s: Annotated[NonNegative, Field(le=1000)] = 0.002
    #: compiled kalman and `identify`: what of `[tolerance]` is [learnt](../explanation/learning.md), the
    #: rest is considered; `"law"` is the scale of each heat law; – is `["convection", "offset_K", "link",
    #: "gain"]`, and `"law"` too where [no thermocouple sits on the
    #: screw](../explanation/learning.md#without-a-sensor-on-the-screw)
    learn: Annotated[tuple[Learnable, ...], Field(max_length=20)] | None = None
    # Luenberger
    #: luenberger: `"bandwidth"` moves the slow poles only; `"kim"` is the paper's rule
    pole_rule: Literal["bandwidth", "kim"] = "bandwidth"
    #: luenberger: rate at which errors decay; – is where the largest steady σ of a heat,
    #: relative to its `initial_sigma_W`, is smallest
    bandwidth_1_s: Annotated[Positive, Field(ge=1e-9, le=1e4)] | None = None

    @property
    def allows(self) -> bool:
        """Whether σ of this estimator contain the tolerances."""
        return self.kind == "luenberger" or (self.kind == "kalman" and self.engine != "filterpy")

    @property
    def learns(self) -> bool:
        """Whether this estimator takes tolerances into its state, where they are learnt or considered."""
        return self.kind == "kalman" and self.engine == "compiled"

    @property
    def screens(self) -> bool:
        """Whether this estimator can screen readings and bound the effect of their faults."""
        return self.kind == "kalman" and self.engine == "compiled"


AHEAD_H = (0.05, 24.0)
"""How far ahead a forecast may look."""


class ForecastSettings(Section):
    """Whether and how often the service forecasts, and how far ahead."""

    enabled: Flag | None = None  #: forecast in the service; by default where every estimated heat has a law
    hours: Annotated[Positive, Field(ge=AHEAD_H[0], le=AHEAD_H[1])] = 1.0  #: how far ahead, up to 24
    #: distance from the steady state that counts as settled
    within_um: Annotated[Positive, Field(ge=0.01, le=1000)] = 2.0
    period_s: Annotated[Positive, Field(ge=5, le=3600)] = 60.0  #: how often, in seconds


class Probing(Section):
    """When to [probe now](../how-to/probe.md#probe-now): before σ of the thermal error exceeds the accuracy
    that the part needs.
    """

    needs_um: Positive | None = None  #: accuracy that the part needs; – is `integrity.limit_um`


class Integrity(Section):
    """How sensor faults are found: readings that no heat can explain are excluded before they correct.

    Only by the compiled Kalman filter; the other estimators refuse what lies beyond their gate.
    """

    enabled: Flag = True  #: whether readings are screened before they correct
    #: assumed rate of unnoticed faults of a sensor, for the bounds: 0 to 0.1
    fault_per_hour: Annotated[NonNegative, Field(le=0.1)] = 1e-4
    #: the same of the common reference; above the default, bounds rest on laws and air alone
    common_fault_per_hour: Annotated[NonNegative, Field(le=0.1)] = 1e-5
    #: random walk of each offset and of the common reference: K after 1 h, grows with √t
    drift_K_sqrt_h: Annotated[NonNegative, Field(le=100.0)] = 0.3
    limit_K: Positive | None = None  #: largest bound of the field in a good estimate; – is no limit
    #: the same of the thermal error; without a bound 4.6 σ count; – is no limit
    limit_um: Positive | None = None
