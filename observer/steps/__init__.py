"""Published steps by time: written beside the readings, an hour a file, and read by what looks back."""
