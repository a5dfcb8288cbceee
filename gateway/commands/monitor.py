"""`usblnav monitor`: a running gateway on the terminal, over Zenoh, from any machine."""

from argparse import Namespace

from gateway.commands.asking import whom


def run(arguments: Namespace) -> int:
    """Show it until Ctrl-C."""
    place, vehicle = whom(arguments)
    from gateway.monitor import watch  # after the check: it takes a while to import

    watch(place, arguments.vehicle or vehicle, arguments.once)
    return 0
