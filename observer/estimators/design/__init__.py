"""What is worked out before a run: gains, where to put sensors, and what an estimator is worth."""
