"""The model and the estimators against the independent truth."""
