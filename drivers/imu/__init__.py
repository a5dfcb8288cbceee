"""Wire formats of inertial measurement units, one module each."""
