"""The numbers by which kernels and the rest of the package name the same things."""

from __future__ import annotations

# Of a channel's value, as `observer.frames.Quality` …
GOOD = 0
MISSING = 1
STALE = 2
REJECTED = 3
# … of an estimate …
ESTIMATE_GOOD = 0
ESTIMATE_STARTING = 1
ESTIMATE_DEGRADED = 2
ESTIMATE_STALE = 3
ESTIMATE_INVALID = 4
# … and of inputs: an input is missing or held; the position of a nut is unknown.
INPUT_LOST = 1
NUT_LOST = 2

# What a parameter that is learnt belongs to, as `observer.model.learning.Kind`.
CONVECTION = 0
CONDUCTIVITY = 1
HEAT_CAPACITY = 2
AMBIENT = 3
END = 4
LAW = 5
OFFSET = 6
PLACE = 7
LAG = 8

TICKS_PER_S = 1e6
"""Step lengths are whole numbers of these: epoch seconds in double precision carry no more (2.4e-7 s)."""

# What a run with fixed gains returns when it is done, in place of the key of a gain that it lacks.
DONE = -1
