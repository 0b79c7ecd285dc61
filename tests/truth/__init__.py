"""Independent truth: closed forms and finite volumes that import nothing of the project they test."""
