"""The past of an axis, asked by time: readings, and estimates as they were, straight from the recordings."""
