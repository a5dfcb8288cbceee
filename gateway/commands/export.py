"""`usblnav export`: what a live run published, from its recording."""

import json
from argparse import Namespace

from gateway.commands import tapes


def run(arguments: Namespace) -> int:
    """Write the files and print what was found."""
    recordings = tapes.named(arguments.recordings)
    from gateway.recording.export import export  # after the check: it takes a while to import

    told = export(recordings, arguments.out)
    tapes.tell_damage(told)
    if arguments.json:
        print(json.dumps(told, indent=2))
    else:
        for key, value in told["recording"].items():
            print(f"{key}: {len(value) if isinstance(value, list) else value}")
        print(f"results in {arguments.out}")
    return 0
