"""The library behind `import observer`: a machine, what is asked of it, and results with named signals."""
