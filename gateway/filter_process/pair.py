"""Both ends of a channel between two processes, which keeps messages whole."""

import socket

BUFFER_BYTES = 1 << 20


def pair() -> tuple[socket.socket, socket.socket]:
    """Both ends: the host's, non-blocking, and the other's."""
    host, other = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    for end in (host, other):
        end.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, BUFFER_BYTES)
    host.setblocking(False)
    return host, other
