"""What a fleet takes: logs a second by workers, memory, many axes under one parent."""
