"""How often a compensation is released without an alarm, over faults that are drawn."""
