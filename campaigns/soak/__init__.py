"""An hour or more of the real service, with faults and clients that come and go: `make soak`."""
