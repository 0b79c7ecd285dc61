"""Machines that are not what their configuration says, and what an observer makes of them."""
