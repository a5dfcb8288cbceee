"""What goes wrong with an emulated instrument, and when."""
