"""What the screening of readings remembers, by column (see `screening`)."""

from __future__ import annotations

# What is remembered of a sensor, by column: the mean of its innovations, over how many, the time since its
# last sample; for how many samples and how long it has been off by what step; …
MEAN, SEEN, SINCE_S, PENDING, PENDING_S, STEP_K = 0, 1, 2, 3, 4, 5
# … why it is excluded, for how long, how much too high it reads, that with what σ, and for how long it has
# agreed; its last reading that was used; the part of its samples that stepped; when it was first excluded,
# and in how many steps; the sensor that it is swapped with.
CAUSE, OUT_S, EXCESS_K, EXCESS_SIGMA_K, AGREES_S, VALUE_degC, UNREST, FIRST_S, STEPS, OTHER = (
    6, 7, 8, 9, 10, 11, 12, 13, 14, 15,
)  # fmt: skip
GUARD = 16

# Causes.
JUMPED, SWAPPED, DEPARTED, RESTLESS = 1, 2, 3, 4

# What is remembered of all: for how long all inputs have been known, how long the estimate still settles and
# is still held not good, what cannot be explained, since when; the common offset, since when; the factor of a
# gain; in how many steps each of both.
AGE_S, SETTLING_S, HOLD_S, LATCH, LATCH_S, COMMON_K, COMMON_S, FACTOR, LATCH_STEPS, COMMON_STEPS = (
    0, 1, 2, 3, 4, 5, 6, 7, 8, 9,
)  # fmt: skip
VERDICT = 10

# What is not explained: unequal steps of all, a gain, a step that could be taken up by no offset.
UNEQUAL, GAIN, NO_OFFSET = 1, 2, 3
