"""How often alarms of heats are false, and how early wear is reported."""
