"""The numbers by which kernels and the rest of the package name the same things."""

from __future__ import annotations

# Of a channel's value, as `observer.frames.Quality` …
GOOD = 0
MISSING = 1
STALE = 2
REJECTED = 3
EXCLUDED = 4
# … of an estimate …
ESTIMATE_GOOD = 0
ESTIMATE_STARTING = 1
ESTIMATE_DEGRADED = 2
ESTIMATE_STALE = 3
ESTIMATE_INVALID = 4
# … of its parts, by column, …
HEAT = 0
FIELD = 1
ERROR = 2
PARTS = 3
# … and of inputs: an input is missing or held; the position of a nut is unknown.
INPUT_LOST = 1
NUT_LOST = 2

# Kinds of a parameter, as `observer.model.learning.Nuisance`, which start or are reported in their own way.
AMBIENT = 3
LAW = 5
OFFSET = 6

# What a heat law that is a product is made of beside factors (`observer.model.law.Product`).
NO_PRODUCT = -1
OF_SPEED = 0
OF_CHANNEL = 1
OF_NOTHING = 2

STILL = 0.1
"""Part of a heat's first σ that is left where the machine stands still."""

TICKS_PER_S = 1e6
"""Step lengths are whole numbers of these: epoch seconds in double precision carry no more (2.4e-7 s)."""

# What a run with fixed gains returns when it is done, in place of the key of a gain that it lacks.
DONE = -1


# What is remembered of a sensor, by column: the mean of its innovations, over how many, the time since its
# last sample; for how many samples and how long it has been off by what step; …
MEAN, SEEN, SINCE_S, PENDING, PENDING_S, STEP_K = 0, 1, 2, 3, 4, 5
# … why it is excluded, for how long, how much too high it reads, that with what σ, and for how long it has
# agreed; its last reading that was used; the part of its samples that stepped; when it was first excluded,
# and in how many steps; the sensor that it is swapped with; by how much its offset was opened of late.
CAUSE, OUT_S, EXCESS_K, EXCESS_SIGMA_K, AGREES_S, VALUE_degC, UNREST, FIRST_S, STEPS, OTHER, OPENED_K2 = (
    6, 7, 8, 9, 10, 11, 12, 13, 14, 15, 16,
)  # fmt: skip
# By how much it was off when it was excluded, and whether it has stepped back by that much since.
SIZE_K, BACK = 17, 18
GUARD = 19

# Causes.
JUMPED, SWAPPED, DEPARTED, RESTLESS = 1, 2, 3, 4

# What is remembered of all: for how long all inputs have been known, how long the estimate still settles and
# is still held not good, what cannot be explained, since when; the common offset, since when; the factor of a
# gain; in how many steps each of both; how much of the prior was added of late, and how much in common.
AGE_S, SETTLING_S, HOLD_S, LATCH, LATCH_S, COMMON_K, COMMON_S, FACTOR, LATCH_STEPS, COMMON_STEPS = (
    0, 1, 2, 3, 4, 5, 6, 7, 8, 9,
)  # fmt: skip
OPENED_PRIOR, OPENED_COMMON_K2 = 10, 11
# Since when the estimate settles or is held back, until when, and in how many steps it ever was.
HELD_S, HELD_UNTIL_S, HELD_STEPS = 12, 13, 14
# The air's last reading, for how long it has not changed, by how much it has leapt, and whether it was seen.
AIR_degC, AIR_S, AIR_OFF_K, AIR_SEEN = 15, 16, 17, 18
# How long the estimator has run, whatever was lost meanwhile.
RUNS_S = 19
VERDICT = 20

# What is not explained: unequal steps of all, a gain, a step that could be taken up by no offset, a drift of
# all, a departure that more than one sensor explains, or none, and a leap of the air's reading.
UNEQUAL, GAIN, NO_OFFSET, DRIFTING, AMBIGUOUS, AIR_LEAPT = 1, 2, 3, 4, 5, 6
