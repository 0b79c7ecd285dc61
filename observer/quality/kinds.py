"""The kinds of conditions: one record a kind, with its sentence, its alarm and the figures that it publishes.

A new kind of condition is one record in `ConditionKind`.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from datetime import UTC, datetime
from enum import Enum
from typing import Any

from observer.align.plausibility import motion_sentence
from observer.estimators.selftest import Fault
from observer.frames import EstimateQuality, Quality
from observer.quality.alarm_classes import (
    CLOCK_ALARM,
    COMPENSATION_ALARM,
    DISK_ALARM,
    ESTIMATE_ALARM,
    HEAT_HIGH_ALARM,
    HEAT_LOW_ALARM,
    HEAT_OFF_LAW_ALARM,
    MODEL_INCONSISTENT_ALARM,
    SENSOR_DISAGREES_ALARM,
    SENSOR_FAULT_ALARM,
    WIRE_ALARM,
    AlarmClass,
)


@dataclass(frozen=True, slots=True)
class Condition:
    """One problem.

    Attributes:
        kind: Its kind, with sentence and alarm.
        about: The sensor, channel, source or driver; empty if it concerns the whole service.
        detail: A fault or a phase in one word, or a reported text.
        since_s: When it began; NaN if that is not known.
        value: Its figure, with the meaning and unit of its kind; NaN without.
        expected: The figure to compare with; NaN without.
        other: A second sensor with the same problem; empty without.
        quality: That of a channel or of the estimate; None for other kinds.
        unit: The unit of a sensor's figures, `K` or `um`.
        returns_s: In how many seconds an excluded sensor is used again; NaN while that is open.
    """

    kind: ConditionKind
    about: str = ""
    detail: str = ""
    since_s: float = math.nan
    value: float = math.nan
    expected: float = math.nan
    other: str = ""
    quality: Quality | EstimateQuality | None = None
    unit: str = "K"
    returns_s: float = math.nan

    @property
    def identity(self) -> tuple[Any, ...]:
        """The identity of the condition, whatever its present figures.

        A report whose identities have changed is published at once.
        """
        is_returning = math.isfinite(self.returns_s)
        return self.kind, self.about, self.other, self.detail, self.quality, is_returning

    @property
    def sentence(self) -> str:
        """The condition in words, with its figures. Programs compare `identity` instead."""
        return self.kind.value.sentence(self)

    @property
    def document(self) -> dict[str, Any]:
        """The published form of the condition."""
        return {
            "kind": self.kind.published_name,
            "about": [name for name in (self.about, self.other) if name],
            "since_s": self.since_s if math.isfinite(self.since_s) else None,
            "reason": self.sentence,
        }


_EPOCH_FROM_S = 1e8  # a smaller time counts from the start of a log


def clock(time_s: float) -> str:
    """Return the hour and minute of an epoch time, or seconds for a time that counts from a log's start.

    Args:
        time_s: The time; below 1e8 s it counts from the start of a log.
    """
    if time_s < _EPOCH_FROM_S:
        return f"{time_s:.0f} s"
    return f"{datetime.fromtimestamp(time_s).astimezone():%H:%M}"


def _date(time_s: float) -> str:
    """A time that may be days ago."""
    if time_s < _EPOCH_FROM_S:
        return f"{time_s:.0f} s"
    return f"{datetime.fromtimestamp(time_s, UTC):%Y-%m-%d %H:%M} UTC"


def _detail(c: Condition, before: str = ": ", after: str = "") -> str:
    """The detail between two texts, empty without one."""
    return f"{before}{c.detail}{after}" if c.detail else ""


def _quality(c: Condition) -> str:
    return "" if c.quality is None else c.quality.label


def _high_or_low(c: Condition) -> str:
    return "high" if c.value > 0.0 else "low"


def _symbol(c: Condition) -> str:
    return "µm" if c.unit == "um" else "K"


def _departed(c: Condition) -> str:
    phases = {
        "isothermal": "at rest",
        "heat_up": "while heating up",
        "steady": "in steady work",
        "dwell": "during short stops",
        "cool_down": "while cooling down",
    }
    return (
        f"the model's prediction has departed from sensor {c.about} since {_date(c.since_s)}, most "
        f"{phases.get(c.detail, '')}: {c.value:.1f} K rms where its tolerances allow {c.expected:.1f} K; run "
        "`observer discover --recent 8h`"
    )


def _heat_trend(c: Condition) -> str:
    return "" if math.isnan(c.expected) else f", {100 * c.expected:+.1f} % a day"


def _rejected(c: Condition) -> str:
    digits = 1 if c.unit == "um" else 2
    reading = f"{c.about} is rejected: {c.value:+.{digits}f} {_symbol(c)}"
    return f"{reading} from the value that the model and the other sensors predict"


_POLLED_WELL_S = 0.025


def _leapt(c: Condition) -> str:
    slow = f"; or the axis is polled too slowly ({c.expected:.2g} s): set period_s to 0.02"
    return (
        f"{c.about} has jumped by {c.value:+.3f} m, farther than an axis can move between two polls: its "
        f"reference was lost or its encoder slipped; correct it, then run `observer reset{_detail(c, ' ')}`"
        f"{slow if c.expected > _POLLED_WELL_S else ''}"
    )


def _excluded(c: Condition) -> str:
    """Sentence for one excluded sensor: wrong, perhaps right, or in agreement again."""
    since = f"since {clock(c.since_s)}"
    if math.isfinite(c.returns_s):
        return f"{c.about} was excluded, {since}; {_used_again(c)}"
    if abs(c.value) < c.expected:  # the other sensors know too little to take it back
        return (
            f"{c.about} is excluded, {since}; it reads {c.value:+.1f} ± {c.expected:.1f} {_symbol(c)} off, "
            "which may be right; if the sensor is correct, run `observer reset`"
        )
    return (
        f"{c.about} reads {abs(c.value):.1f} ± {c.expected:.1f} {_symbol(c)} too {_high_or_low(c)} and is "
        "excluded; check it: it is used again ten minutes after it reads right, or at once after "
        f"`observer reset`, {since}"
    )


def _swapped(c: Condition) -> str:
    names, since = ", ".join(sorted(filter(None, (c.about, c.other)))), f"since {clock(c.since_s)}"
    if math.isfinite(c.returns_s):
        return f"{names} were exchanged and excluded, {since}; {_used_again(c)}"
    return (
        f"{names} are exchanged and excluded; exchange their plugs; they are used again ten minutes later, "
        f"or at once after `observer reset`, {since}"
    )


def _used_again(c: Condition) -> str:
    minutes = max(math.ceil(c.returns_s / 60.0), 1)
    return f"{c.about} agrees again and is used in {minutes} min, or at once after `observer reset`"


Sentence = Callable[[Condition], str]
_FIGURES = ("value", "expected", "since_s")


@dataclass(frozen=True, slots=True, eq=False)
class KindRecord:
    """The description of a kind of condition.

    Attributes:
        sentence: Returns the text of one condition, with its remedy and without full stop.
        alarm: The class of the alarm that it raises; None for a reason of health only.
        target: The alarm's target if the condition names nothing.
        alarm_name: Distinguishes several alarms of one target; None without.
        alarm_from: The condition's value from which the alarm is raised.
        figures: The names of the condition's value, expected value and time in the alarm.
        fault: The finding of the self-test or the screening that has this kind; None without.
        excess_unit: The unit of the excess of a channel that the condition excludes; None if it excludes
            none.
        is_beside_the_error: Whether field and thermal error are unaffected.
    """

    sentence: Sentence
    alarm: AlarmClass | None = None
    target: str = ""
    alarm_name: str | None = None
    alarm_from: float = -math.inf
    figures: tuple[str, ...] = ()
    fault: Fault | None = None
    excess_unit: str | None = None
    is_beside_the_error: bool = False


def _test(fault: Fault, sentence: Sentence, **fields: Any) -> KindRecord:
    """A kind that a test finds, so that its sentence ends with the time since when it fails."""
    return KindRecord(lambda c: f"{sentence(c)}, since {clock(c.since_s)}", fault=fault, **fields)


class ConditionKind(Enum):
    """All kinds of conditions; the value of each is its record."""

    STEP_FAILED = KindRecord(
        lambda c: f"the estimator's step failed: {c.detail}", ESTIMATE_ALARM, target="estimator"
    )
    # the alarm of a channel is that of its fault
    CHANNEL = KindRecord(
        lambda c: f"channel {c.about} is {_quality(c)}{_detail(c, ' (', ')')}",
        SENSOR_FAULT_ALARM,
    )
    DRIVER = KindRecord(lambda c: f"driver {c.about} is not connected{_detail(c)}", WIRE_ALARM)
    SILENT = KindRecord(
        lambda c: (
            f"driver {c.about} is open but receives nothing{_detail(c)}; check that its senders run, the bit "
            "rate, cable and adapter; it is opened again until a frame comes"
        ),
        WIRE_ALARM,
    )
    BUS = KindRecord(
        lambda c: (
            f"the CAN bus of driver {c.about} reports {c.detail} ({c.value:.0f} error frames so far): a "
            "wrong bit rate, a missing or third terminator of 120 Ω, a broken, swapped or shorted wire, or "
            "no other node that acknowledges; an interface that stays bus-off must be restarted"
        )
    )
    RECORDING = KindRecord(lambda c: f"recording: {c.detail}", DISK_ALARM, target="recording")
    PUBLISHING = KindRecord(lambda c: f"publishing: {c.detail}")
    DEPARTED = KindRecord(_departed, MODEL_INCONSISTENT_ALARM, figures=("rms_K", "allowed_K", "since_s"))
    NOTICE = KindRecord(lambda c: c.detail)
    CLOCK = KindRecord(
        lambda c: (
            f"the computer's clock stepped by {c.value:+.1f} s; the service takes over the new time once "
            "that is steady"
        ),
        CLOCK_ALARM,
        target="computer",
    )
    NO_ESTIMATE = KindRecord(lambda _: "no estimate yet: the first step is still to come")
    JUST_BEGUN = KindRecord(
        lambda _: (
            "the estimate has just begun: readings are checked for 20 s and must fix the screw's temperature"
        )
    )
    UNEXPLAINED = KindRecord(
        lambda c: (
            f"the estimate is {_quality(c)} although no channel and no "
            "test gives a reason; an estimator of your own may set this itself, otherwise reset it and "
            "report this"
        )
    )
    OFFSET_MOVED = KindRecord(
        lambda c: (
            f"{c.about} reads {c.value - c.expected:+.2f} K off its first {c.detail} h of service, by its "
            "learnt offset; check the sensor and its contact"
        ),
        SENSOR_DISAGREES_ALARM,
        alarm_name="drifting",
        figures=("offset_K", "usual_K"),
    )
    HEAT_HIGH = KindRecord(
        lambda c: (
            f"the heat of {c.about} is {c.value:.2f} times the value learnt for its speed and temperature in "
            f"{c.detail} h of running{_heat_trend(c)}"
        ),
        HEAT_HIGH_ALARM,
    )
    HEAT_LOW = KindRecord(
        lambda c: (
            f"the heat of {c.about} has fallen to {c.value:.2f} of the value learnt for its speed and "
            f"temperature in {c.detail} h of running{_heat_trend(c)}"
        ),
        HEAT_LOW_ALARM,
    )
    HEATS_TOGETHER = KindRecord(
        lambda c: (
            f"all heats that depend on {c.about} are {c.value:.2f} times the value learnt in {c.detail} h of "
            "running; check that channel, the film and the lubrication"
        ),
        HEAT_OFF_LAW_ALARM,
    )
    RELEASED = KindRecord(
        lambda c: f"compensation {c.detail}", COMPENSATION_ALARM, target="released", is_beside_the_error=True
    )
    NOT_ZEROED = KindRecord(lambda c: f"compensation: {c.detail}", is_beside_the_error=True)
    BIASED = _test(
        Fault.BIASED,
        lambda c: (
            f"{c.about} and the model disagree by {c.value:+.2g} σ on average; check the sensor's "
            "offset and position, the film and the ambient"
        ),
    )
    COLOURED = _test(
        Fault.COLOURED,
        lambda c: (
            f"the deviations of {c.about} from the model persist (product of consecutive ones "
            f"{c.value:+.2g} σ², 0 for noise); check its position, its lag and the heats near it"
        ),
    )
    NOISY = _test(
        Fault.NOISY,
        lambda c: f"{c.about} scatters {c.value:.1f} times as much as its noise and the model allow",
        alarm=SENSOR_DISAGREES_ALARM,
        alarm_name="noisy",
        alarm_from=3.0,
        figures=_FIGURES,
    )
    REFUSED = _test(
        Fault.REFUSED, _rejected, alarm=SENSOR_DISAGREES_ALARM, alarm_name="refused", figures=_FIGURES
    )
    UNKNOWN = _test(
        Fault.UNKNOWN,
        lambda c: (
            f"the heat of {c.about} is still uncertain: ±{c.value:.3g} W, needed ±{c.expected:.3g} W; it "
            "settles while the axis works"
        ),
        is_beside_the_error=True,
    )
    OFF_LAW = _test(
        Fault.OFF_LAW,
        lambda c: (
            f"the heat of {c.about} is {c.value:.3g} W, by its law {c.expected:.3g} W; check units, the "
            "sensors near it, the nut's position and the law"
        ),
        alarm=HEAT_OFF_LAW_ALARM,
        figures=_FIGURES,
    )
    ALL_OFF_LAW = _test(
        Fault.ALL_OFF_LAW,
        lambda c: (
            f"all heats together are off their laws by {c.value:+.1f} σ; check film, ambient, and the "
            "module and reference that all sensors share"
        ),
        alarm=HEAT_OFF_LAW_ALARM,
        target="all",
        figures=_FIGURES,
    )
    MOTION = _test(Fault.MOTION, lambda c: motion_sentence(c.about, "the speed", c.value))
    LEAPT = _test(Fault.LEAPT, _leapt, excess_unit="m")
    EXCLUDED = KindRecord(_excluded, fault=Fault.EXCLUDED, excess_unit="K")
    SWAPPED = KindRecord(_swapped, fault=Fault.SWAPPED, excess_unit="K")
    SHARED_OFFSET = _test(
        Fault.SHARED_OFFSET,
        lambda c: (
            f"all sensors began to read {abs(c.value):.2f} K too {_high_or_low(c)} at once, as from a "
            "reference junction; this is corrected"
        ),
    )
    GAIN = _test(
        Fault.GAIN,
        lambda c: (
            f"all sensors began to show {c.value:.0%} of their rise above the air at once; check the "
            "converter's range, then run `observer reset`"
        ),
    )
    ALL_STEPPED = _test(
        Fault.UNEXPLAINED,
        lambda _: (
            "all sensors stepped at once, which no heat can cause; check the converter, then run "
            "`observer reset`"
        ),
    )
    DRIFTING = _test(
        Fault.DRIFTING,
        lambda _: (
            "all sensors together depart from the heat laws and the ambient, faster than drift allows; check "
            "their module and reference, and the laws, then run `observer reset`"
        ),
    )
    AMBIGUOUS = _test(
        Fault.AMBIGUOUS,
        lambda _: (
            "the sensors do not agree with each other, and it is unclear which of them is wrong; check all "
            "of them, then run `observer reset`"
        ),
    )
    SETTLING = _test(
        Fault.SETTLING,
        lambda _: "the estimate is settling, after readings that stepped, returned, or do not agree",
    )
    AIR_LEAPT = _test(
        Fault.AIR_LEAPT,
        lambda c: (
            f"the air's temperature has jumped by {c.value:+.1f} K, faster than air can change; check its "
            "sensor, then run `observer reset`"
        ),
    )

    @property
    def published_name(self) -> str:
        """The name of the kind in documents. A finding of a test has the name of its fault."""
        fault = self.value.fault
        return (self.name if fault is None else fault.name).lower()


KIND_OF_FAULT = {kind.value.fault: kind for kind in ConditionKind if kind.value.fault is not None}
"""The kind of condition of each fault that the self-test and the screening find."""
