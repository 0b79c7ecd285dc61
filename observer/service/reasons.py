"""What the self-test found, in words."""

from __future__ import annotations

from datetime import datetime

from observer.estimators.selftest import Fault, Finding
from observer.plausibility import motion_sentence

_EPOCH_FROM_S = 1e8  # a smaller time counts from the start of a log


def sentence(finding: Finding) -> str:
    """Say what fails, since when, and what to look at."""
    return f"{_what(finding)}, since {clock(finding.since_s)}"


def clock(time_s: float) -> str:
    """A time as people read it: hour and minute, or seconds where a log counts from its own start."""
    if time_s < _EPOCH_FROM_S:
        return f"{time_s:.0f} s"
    return f"{datetime.fromtimestamp(time_s).astimezone():%H:%M}"


def _what(finding: Finding) -> str:
    subject, value, expected = finding.subject, finding.value, finding.expected
    match finding.fault:
        case Fault.BIASED:
            return (
                f"{subject} and the model disagree by {value:+.1f} σ on average: an offset, its place, or film "
                "and ambient"
            )
        case Fault.COLOURED:
            return f"what {subject} shows beyond the model is no noise (it repeats by {value:.0%})"
        case Fault.NOISY:
            return f"{subject} is {value:.1f} times as restless as noise_K and the model say"
        case Fault.REFUSED:
            return f"{subject} is refused: {value:+.2f} K from what model and other sensors expect"
        case Fault.UNKNOWN:
            return f"the heat of {subject} is not known yet (σ {value:.3g} W, at the start {expected:.3g} W)"
        case Fault.OFF_LAW:
            return (
                f"the heat of {subject} is {value:.3g} W where its law says {expected:.3g} W: a unit, a sensor, "
                "the nut's position, or the model"
            )
        case Fault.ALL_OFF_LAW:
            return (
                f"all heats together are off their laws by {value:+.1f} σ: film, ambient, or what all sensors "
                "share"
            )
        case Fault.MOTION:
            return motion_sentence(subject, "the speed", value)
