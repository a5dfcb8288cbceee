"""Error states, measurement models and the Kalman update: estimation without I/O or clocks."""
