"""Runs through everything that is compiled, by the doors that the product itself uses, in recorded order."""

from __future__ import annotations

from tests.bits import filters, fixed_gains, histories, inputs

CASES = filters.CASES | fixed_gains.CASES | histories.CASES | inputs.CASES
