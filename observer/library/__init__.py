"""The library behind `import observer`: a machine, its methods, and results with named signals."""
