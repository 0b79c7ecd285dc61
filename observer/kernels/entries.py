"""Where Python enters: the loops over many steps, which let other threads go on meanwhile."""

from __future__ import annotations

import cython  # type: ignore[import-untyped]

from observer.kernels.fixed_gain import observe
from observer.kernels.kalman import filter_steps
from observer.kernels.march import march_steps
from observer.kernels.smoother import filter_with_tape, smooth_back


def run_kalman(p, t, u, step, state, gate_sigma, out, work):
    """Run the Kalman filter over the K steps of `u` (see `kalman.filter_steps`)."""
    with cython.nogil:
        filter_steps(p, t, u, step, state, gate_sigma, out, work)


def run_fixed_gain(
    p, t, rungs, u, step, state, gate_sigma, optimal, gains, out, first, resumed, work, c, allowed
):
    """Run an observer with fixed gains (see `fixed_gain.observe`)."""
    with cython.nogil:
        done = observe(
            p, t, rungs, u, step, state, gate_sigma, optimal, gains, out, first, resumed, work, c, allowed
        )
    return done  # noqa: RET504  (Python takes part again only here)


def run_forward(p, t, u, step, state, gate_sigma, work, tape):
    """Run the smoother's way forward (see `smoother.filter_with_tape`)."""
    with cython.nogil:
        filter_with_tape(p, t, u, step, state, gate_sigma, work, tape)


def run_backward(p, t, u, step, tape, adjoint, work, out):
    """Run the smoother's way back (see `smoother.smooth_back`)."""
    with cython.nogil:
        smooth_back(p, t, u, step, tape, adjoint, work, out)


def march(p, t, decay, u, B, C, work, x, states, first):
    """Run the open loop (see `march.march_steps`)."""
    with cython.nogil:
        march_steps(p, t, decay, u, B, C, work, x, states, first)
