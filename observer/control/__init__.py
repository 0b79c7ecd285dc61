"""Compensation of the thermal error, and writing it to a control."""
