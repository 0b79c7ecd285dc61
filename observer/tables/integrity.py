"""The configuration's table of how sensor faults are found."""

from __future__ import annotations

from observer.tables.quantities import Section


class Integrity(Section):
    """How sensor faults are found: readings that no heat can explain are excluded before they correct.

    Only by the compiled Kalman filter; the other estimators refuse what lies beyond their gate.
    """

    enabled: bool = True
