"""One module for each command: `run(arguments)` does it and gives the exit code."""
