"""Recordings (MCAP) of a run: every device's bytes as they came, and all that was made of them.

The daemon's `host.Recorder` hands events in batches to the `writer`, a process of its own, so that
a slow, full or missing disk is never felt. `reader` gives the events back in the order in which the
daemon took them, from which a replay makes the same solutions again. docs/recording.md has the
topics and what a file holds.
"""
