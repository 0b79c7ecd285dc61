"""Heated rods, and the search for what is hidden in them."""
