"""Alarms: what is wrong for so long, and matters so much, that somebody is to come and look."""
