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

STILL = 0.1
"""Part of a heat's first σ that is left where the machine stands still."""

TICKS_PER_S = 1e6
"""Step lengths are whole numbers of these: epoch seconds in double precision carry no more (2.4e-7 s)."""

# What a run with fixed gains returns when it is done, in place of the key of a gain that it lacks.
FINISHED = -1


# Why a sensor is excluded.
JUMPED, SWAPPED, DEPARTED, RESTLESS = 1, 2, 3, 4

# What is not explained: unequal steps of all, a gain, a step that could be taken up by no offset, a drift of
# all, a departure that more than one sensor explains, or none, and a leap of the air's reading.
UNEQUAL, GAIN, NO_OFFSET, DRIFTING, AMBIGUOUS, AIR_LEAPT = 1, 2, 3, 4, 5, 6
