"""Laws of physics and what materials are: film, friction, air. Functions of numbers, nothing else."""
