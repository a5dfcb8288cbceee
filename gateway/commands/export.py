"""`usblnav export`: what a live run published, from its recording."""

import json
from argparse import Namespace

from gateway.errors import ConfigError


def run(arguments: Namespace) -> int:
    """Write the files and print what was found."""
    absent = [str(path) for path in arguments.recordings if not path.exists()]
    if absent:
        raise ConfigError([f"{path}: no such file" for path in absent])
    from gateway.recording.export import export  # after the check: it takes a while to import

    told = export(arguments.recordings, arguments.out)
    if arguments.json:
        print(json.dumps(told, indent=2))
    else:
        for key, value in told["recording"].items():
            print(f"{key}: {value}")
        print(f"results in {arguments.out}")
    return 0
