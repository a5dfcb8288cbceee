"""The filter as an OS process: its host in the daemon, the template it is forked from, itself."""
