"""Wire formats of satellite receivers, one module each."""
