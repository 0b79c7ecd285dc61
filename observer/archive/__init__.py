"""The past of an axis by time: readings, and estimates as they were, straight from the recordings."""
