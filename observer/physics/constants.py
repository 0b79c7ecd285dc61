"""Constants of nature; those of units are in `observer.units`."""

GRAVITY_M_S2 = 9.80665
STEFAN_BOLTZMANN_W_m2K4 = 5.670374419e-8
"""CODATA 2018."""
