"""A long run of the whole gateway among faults, with a table of figures at its end."""
