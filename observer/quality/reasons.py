"""The reasons for steps of a log that are not good, with their numbers of steps."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence

import numpy as np

from observer.estimators.selftest import Finding
from observer.frames import EstimateBlock, EstimateQuality, FrameBlock, Quality
from observer.quality.conditions import of_channel, of_finding
from observer.quality.kinds import Condition, ConditionKind


class NotGood:
    """Counts the steps of a log that are not good, for each condition, block by block.

    Every step that is not good has at least one reason.
    """

    def __init__(self, channels: Sequence[str]) -> None:
        """Begin before the first step.

        Args:
            channels: The channels of the frames, in their order.
        """
        self._channels = channels
        self._steps = np.zeros((len(channels), len(Quality)), dtype=np.int64)
        self._is_starting = True
        self._conditions: Counter[Condition] = Counter()

    def take(self, frames: FrameBlock, block: EstimateBlock) -> None:
        """Add the frames of a block and its estimates, both of the same K steps."""
        qualities = frames.quality[block.quality != EstimateQuality.GOOD]
        for quality in Quality:
            self._steps[:, quality] += np.count_nonzero(qualities == quality, axis=0)
        # the self-test only degrades an estimate, so a worse quality without a bad channel has no reason
        has_bad_channel = (frames.quality != Quality.GOOD).any(axis=1)
        has_bad_sensor = (block.sensor_quality != Quality.GOOD).any(axis=1)
        without_reason = ~has_bad_channel & ~has_bad_sensor
        for worst in (EstimateQuality.STALE, EstimateQuality.INVALID):
            n = np.count_nonzero((block.quality == worst) & without_reason)
            self._conditions[Condition(ConditionKind.UNEXPLAINED, quality=worst)] += int(n)
        first_steps = np.logical_and.accumulate(block.quality == EstimateQuality.STARTING) & self._is_starting
        self._is_starting = bool(first_steps[-1])
        self._conditions[Condition(ConditionKind.JUST_BEGUN)] += int(
            np.count_nonzero(first_steps & without_reason)
        )

    def note(self, findings: Iterable[tuple[Finding, int]]) -> None:
        """Add the findings of the self-test up to its end or a reset, with their numbers of steps."""
        for finding, steps in findings:
            self._conditions[of_finding(finding)] += steps

    @property
    def of_heats(self) -> dict[str, int]:
        """Every reason that concerns heats alone as a sentence, and in how many steps it held."""
        return {
            c.sentence: steps
            for c, steps in self._conditions.items()
            if c.kind is ConditionKind.UNKNOWN and steps
        }

    @property
    def reasons(self) -> dict[str, int]:
        """Every other reason as a sentence, and in how many steps it held."""
        words: Counter[str] = Counter()
        for j, name in enumerate(self._channels):
            for quality in list(Quality)[1:]:
                words[of_channel(name, quality).sentence] += int(self._steps[j, quality])
        remaining = (item for item in self._conditions.items() if item[0].kind is not ConditionKind.UNKNOWN)
        for condition, steps in remaining:
            words[condition.sentence] += steps
        return {text: steps for text, steps in words.items() if steps}
