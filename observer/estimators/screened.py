"""What the screening of readings has found (see `observer.kernels.screening`), as findings."""

from __future__ import annotations

from observer.estimators.protocol import EstimatorState
from observer.estimators.selftest import Fault, Finding
from observer.frames import Layout
from observer.kernels import remembered as of

_LATCHED = {
    of.GAIN: Fault.GAIN, of.DRIFTING: Fault.DRIFTING, of.AMBIGUOUS: Fault.AMBIGUOUS,
    of.AIR_LEAPT: Fault.AIR_LEAPT,
}  # fmt: skip
"""What is said of what needs a person; unequal steps, and equal ones that no offset takes up, are none of
these.
"""


def findings(layout: Layout, state: EstimatorState) -> tuple[Finding, ...]:
    """What is found now."""
    return tuple(finding for finding, _ in _of_all(layout, state, now=True))


def history(layout: Layout, state: EstimatorState) -> tuple[tuple[Finding, int], ...]:
    """What has ever been found, and in how many steps."""
    return tuple(_of_all(layout, state, now=False))


def _of_all(layout: Layout, state: EstimatorState, *, now: bool) -> list[tuple[Finding, int]]:
    found = []
    for name, own in zip(layout.sensors, state.guard, strict=False):
        if own[of.CAUSE] if now else own[of.STEPS]:
            fault, other = Fault.EXCLUDED, name
            if own[of.CAUSE] == of.SWAPPED:
                fault, other = Fault.SWAPPED, f"{name}, {layout.sensors[int(own[of.OTHER])]}"
            excess_K, sigma_K = float(own[of.EXCESS_K]), float(own[of.EXCESS_SIGMA_K])
            found.append(
                (Finding(fault, other, float(own[of.FIRST_S]), excess_K, sigma_K), int(own[of.STEPS]))
            )
    verdict = state.verdict
    if verdict[of.COMMON_K]:
        finding = Finding(
            Fault.SHARED_OFFSET, "", float(verdict[of.COMMON_S]), float(verdict[of.COMMON_K]), 0.0
        )
        found.append((finding, int(verdict[of.COMMON_STEPS])))
    if verdict[of.LATCH]:
        fault = _LATCHED.get(int(verdict[of.LATCH]), Fault.UNEXPLAINED)
        finding = Finding(fault, "", float(verdict[of.LATCH_S]), float(verdict[of.FACTOR]), 1.0)
        found.append((finding, int(verdict[of.LATCH_STEPS])))
    if max(verdict[of.HOLD_S], verdict[of.SETTLING_S]) > 0.0 if now else verdict[of.HELD_STEPS] > 0.0:
        finding = Finding(Fault.SETTLING, "", float(verdict[of.HELD_S]), 0.0, 0.0)
        found.append((finding, int(verdict[of.HELD_STEPS])))
    return found
