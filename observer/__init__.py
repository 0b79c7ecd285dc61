"""Ballscrew Observer: a ball screw's temperature field, heat inputs and thermal error, in real time."""

import os

# Matrices here are small: BLAS' threads would only wait for each other, and the more so beside other work.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
