"""An independent machine with a hidden effect: rings × slices of a screw, its nut, ends, sensors and logs."""
