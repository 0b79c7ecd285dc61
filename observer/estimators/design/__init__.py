"""Design before a run: gains, positions of sensors, and the σ of an estimator."""
