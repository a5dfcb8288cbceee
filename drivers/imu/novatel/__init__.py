"""NovAtel SPAN: the inertial logs of OEM receivers, binary and ASCII."""
