"""Why estimates are not good, for each step of a log: what channels lack, and what the self-test finds."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from observer.estimators.selftest import Finding
from observer.frames import EstimateBlock, EstimateQuality, FrameBlock, Quality
from observer.quality.reasons import channel_sentence, sentence, unexplained


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
