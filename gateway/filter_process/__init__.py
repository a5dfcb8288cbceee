"""The filter as an OS process of its own: its host in the daemon, its worker, and their channel."""
