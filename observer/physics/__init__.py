"""Laws of physics and what materials are; constants. Functions of numbers, nothing else."""
