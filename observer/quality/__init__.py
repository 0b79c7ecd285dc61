"""How good the estimates are, in words: residual beyond the tolerances, health, alarms, remedies."""
