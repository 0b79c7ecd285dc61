"""Ballscrew Observer: a ball screw's temperature field, heat inputs and thermal error, in real time."""

from observer.compile_cache import choose_compile_cache

choose_compile_cache()
