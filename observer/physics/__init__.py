"""Laws of physics, properties of materials, and constants. Functions of numbers, nothing else."""
