"""Which senders a UDP link admits."""

import ipaddress
from collections.abc import Callable, Iterable
from functools import lru_cache


def source_filter(allow: Iterable[str]) -> Callable[[str | bytes], bool]:
    """Predicate of a sender's address: is it in the list? An empty list admits everybody.

    Parameters
    ----------
    allow
        Addresses or networks (``192.168.1.7``, ``10.0.0.0/8``, ``fd00::/64``).

    Returns
    -------
    callable
        Takes an address as text or as packed bytes (4 or 16). An IPv4 address mapped into IPv6, as
        a dual-stack socket reports it, is judged as the IPv4 address it is.

    Raises
    ------
    ValueError
        For an entry that is neither an address nor a network.
    """
    networks = [ipaddress.ip_network(entry, strict=False) for entry in allow]
    if not networks:
        return lambda _address: True

    @lru_cache(maxsize=1024)  # bounded: anybody can invent senders
    def admits(address: str | bytes) -> bool:
        sender = ipaddress.ip_address(address)
        mapped = getattr(sender, "ipv4_mapped", None)
        return any((mapped or sender) in network for network in networks)

    return admits
