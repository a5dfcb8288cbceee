"""What the gateway asks of the machine it runs on: which boot it is, signals, priority, its log."""
