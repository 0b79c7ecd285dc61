"""Physical effects that a configuration may add to the model, each one small object."""
