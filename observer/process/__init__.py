"""A process's access to its system: time, signals, messages, memory, the service manager."""
