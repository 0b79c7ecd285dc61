"""The next hour: temperatures and thermal error, by the current program or a given one."""
