"""What the self-test found, in words."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from datetime import UTC, datetime

import numpy as np

from observer.align.plausibility import motion_sentence
from observer.estimators.selftest import Fault, Finding
from observer.frames import EstimateBlock, EstimateQuality, FrameBlock, Quality
from observer.quality.gap import Departure

_EPOCH_FROM_S = 1e8  # a smaller time counts from the start of a log


def sentence(finding: Finding) -> str:
    """Say what fails, since when, and what to look at."""
    return f"{_what(finding)}, since {clock(finding.since_s)}"


def channel_sentence(name: str, quality: str, fault: str | None = None) -> str:
    """Say that a channel is not good, and with which fault."""
    return f"channel {name} is {quality}" + (f" ({fault})" if fault else "")


def unexplained(quality: EstimateQuality) -> str:
    """Say that neither channels nor self-test say why an estimate is not good."""
    return (
        f"the estimate is {quality.label} although no channel and no test says why; reset it, and report this"
    )


def departure_sentence(found: Departure) -> str:
    """Say from which sensor the prediction has departed, since when, by how much, and what to do."""
    since = f"{found.since_s:.0f} s"
    if found.since_s >= _EPOCH_FROM_S:
        since = f"{datetime.fromtimestamp(found.since_s, UTC):%Y-%m-%d %H:%M} UTC"
    return (
        f"the model's prediction has departed from sensor {found.sensor} since {since}, most "
        f"{_WHILE[found.phase]}: {found.rms_K:.1f} K rms where its tolerances allow {found.allowed_K:.1f} K; "
        "run `observer discover --recent 8h`"
    )


def clock(time_s: float) -> str:
    """A time as people read it: hour and minute, or seconds where a log counts from its own start."""
    if time_s < _EPOCH_FROM_S:
        return f"{time_s:.0f} s"
    return f"{datetime.fromtimestamp(time_s).astimezone():%H:%M}"


def _what(finding: Finding) -> str:
    subject, value, expected = finding.subject, finding.value, finding.expected
    if finding.fault is Fault.MOTION:
        return motion_sentence(subject, "the speed", value)
    if finding.fault in (Fault.EXCLUDED, Fault.SHARED_OFFSET):
        way = "high" if value > 0.0 else "low"
        return _SENTENCES[finding.fault].format(subject=subject, value=abs(value), expected=expected, way=way)
    if finding.fault is Fault.SWAPPED:  # each of the two finds the same
        subject = ", ".join(sorted(subject.split(", ")))
    return _SENTENCES[finding.fault].format(subject=subject, value=value, expected=expected)


_WHILE = {
    "isothermal": "at rest",
    "heat_up": "while heating up",
    "steady": "in steady work",
    "dwell": "during short stops",
    "cool_down": "while cooling down",
}
_SENTENCES = {
    Fault.BIASED: "{subject} and the model disagree by {value:+.2g} σ on average: an offset, a place, or "
    "film and ambient",
    Fault.COLOURED: "what {subject} shows beyond the model is no noise: one sample deviates as the last did "
    "(mean product {value:+.2g} σ², that of noise is 0)",
    Fault.NOISY: "{subject} is {value:.1f} times as restless as its noise_K and the model say",
    Fault.REFUSED: "{subject} is refused: {value:+.2f} K from what the model and the other sensors expect",
    Fault.UNKNOWN: "the heat of {subject} is not known yet (σ {value:.3g} W, {expected:.3g} W at the start)",
    Fault.OFF_LAW: "the heat of {subject} is {value:.3g} W where its law says {expected:.3g} W: a unit, a "
    "sensor, the nut's position, or the model",
    Fault.ALL_OFF_LAW: "all heats together are off their laws by {value:+.1f} σ: film, ambient, or something "
    "that all sensors share",
    Fault.LEAPT: "{subject} has leapt by {value:+.3f} m, which the speed does not explain: homed anew, or a "
    "slipped encoder; where the nut is is not known until a reset",
    Fault.EXCLUDED: "{subject} reads {value:.1f} ± {expected:.1f} K too {way} and is left out; look at it",
    Fault.SWAPPED: "{subject} have taken each other's place and are left out; look at their connectors",
    Fault.SHARED_OFFSET: "all sensors began to read {value:.2f} K too {way} at once, as by a reference "
    "junction; it is taken out of them",
    Fault.GAIN: "all sensors began to show {value:.0%} of their rise above the air at once; look at the "
    "converter's range, then reset",
    Fault.UNEXPLAINED: "all sensors stepped at once, which no heat does; look at the converter, then reset",
    Fault.DRIFTING: "all sensors together depart from what laws and air say, faster than they may drift; "
    "look at what they share and at the laws, then reset",
    Fault.AMBIGUOUS: "the sensors do not agree with each other, and which of them is wrong cannot be told; "
    "look at all of them, then reset",
    Fault.AIR_LEAPT: "the air's temperature has leapt by {value:+.1f} K, which no air does; look at its "
    "sensor, then reset",
    Fault.SETTLING: "the estimate settles, after readings that stepped, came back, or do not agree",
}


class NotGood:
    """Counts the steps of a log that are not good by the channels that were not, block by block."""

    def __init__(self, channels: Sequence[str]) -> None:
        """Begin before the first step."""
        self._channels = channels
        self._steps = np.zeros((len(channels), len(Quality)), dtype=np.int64)
        self._found: dict[str, int] = {}

    def take(self, frames: FrameBlock, block: EstimateBlock) -> None:
        """Take the frames of a block and its estimates."""
        given = frames.quality[block.quality != EstimateQuality.GOOD]
        for quality in Quality:
            self._steps[:, quality] += np.count_nonzero(given == quality, axis=0)
        # what no channel explains is the self-test's, which only degrades, and sets nothing aside
        of_channels = (frames.quality != Quality.GOOD).any(axis=1)
        refused = (block.sensor_quality != Quality.GOOD).any(axis=1)
        for worst in (EstimateQuality.STALE, EstimateQuality.INVALID):
            if n := np.count_nonzero((block.quality == worst) & ~of_channels & ~refused):
                self._found[unexplained(worst)] = self._found.get(unexplained(worst), 0) + int(n)

    def note(self, found: Iterable[tuple[Finding, int]]) -> None:
        """Take what the self-test found, each in how many steps, up to its end or a reset."""
        for finding, steps in found:
            said = sentence(finding)
            self._found[said] = self._found.get(said, 0) + steps

    @property
    def reasons(self) -> dict[str, int]:
        """Every reason as a sentence, and in how many steps it held."""
        by_channel = {
            channel_sentence(name, quality.label): int(self._steps[j, quality])
            for j, name in enumerate(self._channels)
            for quality in Quality
            if quality != Quality.GOOD and self._steps[j, quality]
        }
        return by_channel | self._found
