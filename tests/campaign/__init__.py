"""Missions of the emulator, drawn by a seed, through the gateway: ``python -m tests.campaign``."""
