"""Published steps by time: written beside the readings, an hour a file."""
