"""The sentence of each condition, made last and never parsed, and the remedy for a channel."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Sequence
from datetime import UTC, datetime

import numpy as np

from observer.align.plausibility import motion_sentence
from observer.estimators.selftest import Fault, Finding
from observer.frames import EstimateBlock, EstimateQuality, FrameBlock, Quality
from observer.quality.conditions import Condition, Trouble, of_channel, of_finding

_EPOCH_FROM_S = 1e8  # a smaller time counts from the start of a log


def sentence(condition: Condition) -> str:
    """The sentence of a condition: what is wrong, since when if found by a test, and what to look at."""
    kind, about, value = condition.kind, condition.about, condition.value
    if kind is Fault.MOTION:
        return f"{motion_sentence(about, 'the speed', value)}, since {clock(condition.since_s)}"
    high = kind in (Fault.EXCLUDED, Fault.SHARED_OFFSET)
    if kind in (Fault.EXCLUDED, Fault.SWAPPED) and math.isfinite(condition.returns_s):
        return _returning(condition)
    if kind is Fault.EXCLUDED and abs(value) < condition.expected:
        return _perhaps_right(condition)
    sentences = _OF_DISPLACEMENTS if condition.unit == "um" and kind in _OF_DISPLACEMENTS else _SENTENCES
    text = sentences[kind].format(
        about=", ".join(sorted(filter(None, (about, condition.other)))),
        value=abs(value) if high else value,
        way="high" if value > 0.0 else "low",
        expected=condition.expected,
        more=value - condition.expected,
        trend="" if math.isnan(condition.expected) else f", {100 * condition.expected:+.1f} % a day",
        detail=condition.detail,
        why=f": {condition.detail}" if condition.detail else "",
        fault=f" ({condition.detail})" if condition.detail else "",
        quality="" if condition.quality is None else condition.quality.label,
        since=_date(condition.since_s) if kind is Trouble.DEPARTED else "",
        phase=_WHILE.get(condition.detail, ""),
        options=f" {condition.detail}" if condition.detail else "",
        polling=_TOO_SLOW.format(condition.expected) if condition.expected > _POLLED_WELL_S else "",
    )
    return f"{text}, since {clock(condition.since_s)}" if isinstance(kind, Fault) else text


def _returning(condition: Condition) -> str:
    """The sentence of an excluded sensor that agrees with the others again."""
    names = ", ".join(sorted(filter(None, (condition.about, condition.other))))
    was = "was excluded" if condition.kind is Fault.EXCLUDED else "were exchanged and excluded"
    minutes = max(math.ceil(condition.returns_s / 60.0), 1)
    return (
        f"{names} {was}, since {clock(condition.since_s)}; {condition.about} agrees again and is used in "
        f"{minutes} min, or at once after `observer reset`"
    )


def _perhaps_right(condition: Condition) -> str:
    """The sentence of an excluded sensor of which the others know too little to take it back."""
    unit = "µm" if condition.unit == "um" else "K"
    return (
        f"{condition.about} is excluded, since {clock(condition.since_s)}; it reads {condition.value:+.1f} ± "
        f"{condition.expected:.1f} {unit} off, which may be right: if the sensor is, run `observer reset`"
    )


def clock(time_s: float) -> str:
    """A time for people: hour and minute, or seconds where a log counts from its own start."""
    if time_s < _EPOCH_FROM_S:
        return f"{time_s:.0f} s"
    return f"{datetime.fromtimestamp(time_s).astimezone():%H:%M}"


def _date(time_s: float) -> str:
    """A time that may be days ago."""
    if time_s < _EPOCH_FROM_S:
        return f"{time_s:.0f} s"
    return f"{datetime.fromtimestamp(time_s, UTC):%Y-%m-%d %H:%M} UTC"


_POLLED_WELL_S = 0.025
_TOO_SLOW = "; or the axis is polled too slowly ({:.2g} s): set period_s to 0.02"
_WHILE = {
    "isothermal": "at rest",
    "heat_up": "while heating up",
    "steady": "in steady work",
    "dwell": "during short stops",
    "cool_down": "while cooling down",
}
_SENTENCES: dict[Trouble | Fault, str] = {
    Trouble.STEP_FAILED: "the estimator's step failed: {detail}",
    Trouble.CHANNEL: "channel {about} is {quality}{fault}",
    Trouble.DRIVER: "driver {about} is not connected{why}",
    Trouble.SILENT: "driver {about} is open and silent{why}; check that its senders run, the bit rate, cable "
    "and adapter; it is opened again until a frame comes",
    Trouble.BUS: "the CAN bus of driver {about} reports {detail} ({value:.0f} error frames so far): a wrong "
    "bit rate, a missing or third terminator of 120 Ω, a broken, swapped or shorted wire, or no other "
    "node that acknowledges; an interface that stays bus-off must be restarted",
    Trouble.RECORDING: "recording: {detail}",
    Trouble.PUBLISHING: "publishing: {detail}",
    Trouble.DEPARTED: "the model's prediction has departed from sensor {about} since {since}, most {phase}: "
    "{value:.1f} K rms where its tolerances allow {expected:.1f} K; run `observer discover --recent 8h`",
    Trouble.NOTICE: "{detail}",
    Trouble.CLOCK: "the computer's clock stepped by {value:+.1f} s; the service takes over the new time once "
    "that is steady",
    Trouble.JUST_BEGUN: "the estimate has just begun: readings are judged for 20 s, and must say how warm "
    "the screw is",
    Trouble.NO_ESTIMATE: "no estimate yet: the first step is still to come",
    Trouble.UNEXPLAINED: "the estimate is {quality} although no channel and no test gives a reason; an "
    "estimator of your own may set this itself, otherwise reset it and report this",
    Trouble.OFFSET_MOVED: "{about} reads {more:+.2f} K beside what it did in its first {detail} h, by the "
    "offset that is learnt",
    Trouble.HEAT_HIGH: "the heat of {about} is {value:.2f} times what was learnt for its speed and "
    "temperature in {detail} h of running{trend}",
    Trouble.HEAT_LOW: "the heat of {about} has fallen to {value:.2f} of what was learnt for its speed and "
    "temperature in {detail} h of running{trend}",
    Trouble.HEATS_TOGETHER: "all heats that depend on {about} are {value:.2f} times what was learnt in "
    "{detail} h of running: that channel reads wrong, or the film or all lubrication has changed",
    Trouble.RELEASED: "compensation {detail}",
    Trouble.NOT_ZEROED: "compensation: {detail}",
    Fault.BIASED: "{about} and the model disagree by {value:+.2g} σ on average: an offset, a position, "
    "or film and ambient",
    Fault.COLOURED: "the residual of {about} is not noise: each sample deviates as the last did "
    "(mean product {value:+.2g} σ², that of noise is 0)",
    Fault.NOISY: "{about} scatters {value:.1f} times as much as its noise and the model explain",
    Fault.REFUSED: "{about} is rejected: {value:+.2f} K from what the model and the other sensors expect",
    Fault.UNKNOWN: "the heat of {about} is still uncertain: ±{value:.3g} W, needed ±{expected:.3g} W; it "
    "settles while the axis works",
    Fault.OFF_LAW: "the heat of {about} is {value:.3g} W where its law says {expected:.3g} W: a unit, a "
    "sensor, the nut's position, or the model",
    Fault.ALL_OFF_LAW: "all heats together are off their laws by {value:+.1f} σ: film, ambient, or something "
    "that all sensors share",
    Fault.LEAPT: "{about} has jumped by {value:+.3f} m, farther than an axis can move between two polls: its "
    "reference was lost or its encoder slipped; correct it, then run `observer reset{options}`{polling}",
    Fault.EXCLUDED: "{about} reads {value:.1f} ± {expected:.1f} K too {way} and is excluded; check it: it "
    "is used again ten minutes after it reads right, or at once after `observer reset`",
    Fault.SWAPPED: "{about} are exchanged and excluded: put their plugs right; they are used again ten "
    "minutes later, or at once after `observer reset`",
    Fault.SHARED_OFFSET: "all sensors began to read {value:.2f} K too {way} at once, as from a "
    "reference junction; this is corrected",
    Fault.GAIN: "all sensors began to show {value:.0%} of their rise above the air at once; check "
    "the converter's range, then run `observer reset`",
    Fault.UNEXPLAINED: "all sensors stepped at once, which no heat can cause; check the converter, then "
    "run `observer reset`",
    Fault.DRIFTING: "all sensors together depart from laws and air, faster than they may "
    "drift; check what they share, and the laws, then run `observer reset`",
    Fault.AMBIGUOUS: "the sensors do not agree with each other, and it is unclear which of them is "
    "wrong; check all of them, then run `observer reset`",
    Fault.AIR_LEAPT: "the air's temperature has jumped by {value:+.1f} K, which air cannot do; check "
    "its sensor, then run `observer reset`",
    Fault.SETTLING: "the estimate is settling, after readings that stepped, came back, or do not agree",
}
_OF_DISPLACEMENTS: dict[Trouble | Fault, str] = {
    Fault.REFUSED: "{about} is rejected: {value:+.1f} µm from what the model and the other sensors expect",
    Fault.EXCLUDED: "{about} reads {value:.1f} ± {expected:.1f} µm too {way} and is excluded; check it: "
    "it is used again ten minutes after it reads right, or at once after `observer reset`",
}
"""Sentences for a sensor that measures a displacement."""


class NotGood:
    """Counts the steps of a log that are not good by the condition that held, block by block."""

    def __init__(self, channels: Sequence[str]) -> None:
        """Begin before the first step."""
        self._channels = channels
        self._steps = np.zeros((len(channels), len(Quality)), dtype=np.int64)
        self._starting = True
        self._found: Counter[Condition] = Counter()

    def take(self, frames: FrameBlock, block: EstimateBlock) -> None:
        """Take the frames of a block and its estimates."""
        given = frames.quality[block.quality != EstimateQuality.GOOD]
        for quality in Quality:
            self._steps[:, quality] += np.count_nonzero(given == quality, axis=0)
        # what no channel explains is the self-test's, which only degrades, and sets nothing aside
        of_channels = (frames.quality != Quality.GOOD).any(axis=1)
        refused = (block.sensor_quality != Quality.GOOD).any(axis=1)
        by_itself = ~of_channels & ~refused
        for worst in (EstimateQuality.STALE, EstimateQuality.INVALID):
            n = np.count_nonzero((block.quality == worst) & by_itself)
            self._found[Condition(Trouble.UNEXPLAINED, quality=worst)] += int(n)
        first_steps = np.logical_and.accumulate(block.quality == EstimateQuality.STARTING) & self._starting
        self._starting = bool(first_steps[-1])
        self._found[Condition(Trouble.JUST_BEGUN)] += int(np.count_nonzero(first_steps & by_itself))

    def note(self, found: Iterable[tuple[Finding, int]]) -> None:
        """Take the findings of the self-test, with their numbers of steps, up to its end or a reset."""
        for finding, steps in found:
            self._found[of_finding(finding)] += steps

    @property
    def of_heats(self) -> dict[str, int]:
        """Every reason that concerns heats alone as a sentence, and in how many steps it held."""
        return {sentence(c): steps for c, steps in self._found.items() if c.kind is Fault.UNKNOWN and steps}

    @property
    def reasons(self) -> dict[str, int]:
        """Every other reason as a sentence, and in how many steps it held."""
        words: Counter[str] = Counter()
        for j, name in enumerate(self._channels):
            for quality in list(Quality)[1:]:
                words[sentence(of_channel(name, quality))] += int(self._steps[j, quality])
        others = (item for item in self._found.items() if item[0].kind is not Fault.UNKNOWN)
        for condition, steps in others:
            words[sentence(condition)] += steps
        return {text: steps for text, steps in words.items() if steps}


_REMEDIES = {
    "disconnected": "check that the device is on, cabled, and at the address or port of its table",
    "timeout": "no answer in time: check power, cable, unit_id and timeout_s; on a serial line also "
    "baudrate, parity and stopbits",
    "slow_poll": "a poll takes longer than period_s, as the driver's last error says: raise period_s, or "
    "read fewer registers",
    "bad_reply": "the reply does not match the request: check unit_id, and look for a second master",
    "rtu_frames": 'the device answers in RTU frames: set transport = "rtu-over-tcp" for this driver',
    "tiny_number": "the number is too small to be a measurement: check byte_order, type and register; the "
    "driver's last error names the order that fits",
    "silent": "the bus carries no such message: check bit rate, cable, identifier and sender",
    "short_frame": "the message is shorter than its description: check the DBC file or position_byte",
    "bad_frame": "the message does not fit its description: check the DBC file",
    "open_circuit": "a thermocouple's wire is broken or not connected: check the terminals of this input",
    "cold_junction": "the module cannot measure its terminals' temperature: check the module, replace it",
    "under_range": "the thermocouple is the wrong way round, or of another type than the module is set to",
    "over_range": "the thermocouple is of another type than the module is set to, or its wire is open",
    "out_of_range": "the thermocouple's type or its connection is wrong, or low and high are too narrow",
    "register_communication": "the module waits for register commands: switch its control byte back",
    "not_ready": "the module is starting, or not configured: check its project in the controller",
    "module_error": "the module reports an error of its own: check its lamps and its manual",
    "not_a_number": "the device sends something that is not a number: check type and byte_order",
    "unreadable": "the value cannot be read as a number: check the column or the signal",
    "end_of_log": "the log that is played has ended",
    "never_came": "nothing came in time: check the driver's last error and period_s",
}
_EXCEPTIONS = {
    1: 'the device does not know this function: give function = "holding" or "input"',
    2: "the device has no such register: check register, counted from 0 (40001 or 30001 of a manual is 0), "
    "function and first_register",
    3: "the device rejects so many registers: check register and type",
    4: "the device failed to read its own data: check its lamps and its manual",
    6: "the device is busy: raise period_s, and check for a second master",
    10: "the gateway has no path to the unit: check unit_id and the gateway's lines",
    11: "the unit behind the gateway does not answer: check unit_id, power and cable",
}


def remedy_for(fault: str | None, implausible: str | None) -> str | None:
    """What to do about a channel; None where nothing is wrong with it.

    The sentence of an implausible value says what it looks like; the rest says where to fix it.
    """
    if fault is not None:
        if fault.startswith("exception_") and fault[10:].isdigit():
            return _EXCEPTIONS.get(
                int(fault[10:]), "the device rejects the request: look up this exception in its manual"
            )
        return _REMEDIES.get(fault, "look up this fault in the device's table and its manual")
    if implausible is not None:
        return "check scale, offset, type and unit of the channel; if the value is right, check [limits]"
    return None
