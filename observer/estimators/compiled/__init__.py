"""The compiled arithmetic of a step, and what it takes: a plant, steps and inputs as plain arrays."""
