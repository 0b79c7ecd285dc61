"""What a process needs from its system: time, signals, messages, memory, the service manager."""
