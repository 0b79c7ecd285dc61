"""A thermocouple that used to show noise and now repeats one value to the last bit no longer measures."""

from __future__ import annotations

from observer.kernels.libm import isnan

# What is remembered of a channel, by column.
_LAST, _DELTA, _BEND, _BEND_BEFORE, _RUN, _LONGEST, _SEEN = 0, 1, 2, 3, 4, 5, 6
_MEMORY_SAMPLES = 64.0
_YOUNG_SAMPLES = 16.0  # a mean over fewer would take the first step of a smooth curve for noise
_REPEATS = 60.0  # this many equal samples in a row are not noise any more …
_PATIENCE = 3.0  # … unless the channel is known for long repeats: a coarse converter in steady heat
_LONGEST_KNOWN = 200.0
_NOISE_SEEN = 0.35  # of noise_K; white noise bends by 1.95 noise_K a sample, a smooth ramp by nothing


def is_stuck(memory, value, noise_K):
    """Whether a channel is stuck, given one more usable value; `memory` (7,) is updated.

    Noise is judged by the running mean of |Δ_k - Δ_{k-1}|, the bend of the last three samples, because it
    is nothing on the smooth curve of a noise-free log, however steep. The mean is over the samples seen so
    far, but at least 16 and at most 64, so that twenty noisy ones after the start are enough. A channel
    counts as stuck from the 60th repeat on (more if it has repeated for long before), until it changes. NaN
    as `noise_K` means that the channel is no thermocouple.
    """
    last = memory[_LAST]
    memory[_LAST] = value
    if isnan(noise_K) or isnan(last):
        return False
    delta = value - last
    memory[_SEEN] += 1.0
    samples = min(max(memory[_SEEN], _YOUNG_SAMPLES), _MEMORY_SAMPLES)
    memory[_BEND] += (abs(delta - memory[_DELTA]) - memory[_BEND]) / samples
    memory[_DELTA] = delta
    if delta != 0.0:
        memory[_LONGEST] = min(max(memory[_LONGEST], memory[_RUN]), _LONGEST_KNOWN)
        memory[_RUN] = 0.0
        memory[_BEND_BEFORE] = memory[_BEND]
        return False
    memory[_RUN] += 1.0
    limit = max(_REPEATS, _PATIENCE * memory[_LONGEST])
    return memory[_RUN] >= limit and memory[_BEND_BEFORE] >= _NOISE_SEEN * noise_K
