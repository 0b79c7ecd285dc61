"""Heat laws: how much a source delivers, from speed, torque or a measured power."""
