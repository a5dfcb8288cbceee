"""The navigation gateway: time, estimation, outputs and the daemon that joins them."""
