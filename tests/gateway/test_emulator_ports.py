"""The emulator's ports: terminals, serial lines and TCP clients that come and go."""

import itertools
import os
import socket

import pytest

from gateway.emulator.ports import open_port, paced
from gateway.emulator.scenario import PtyPort, SerialPort, TcpServerPort
from gateway.emulator.streams import Emission
from gateway.errors import UsblnavError
from tests.loopback import free_port


def test_a_serial_line_takes_its_time():
    port = PtyPort(symlink="unused", baud=9600)
    sentence = bytes(range(40))
    pieces = list(paced([Emission(1.0, "u", sentence), Emission(1.01, "u", sentence)], port))
    assert b"".join(p.data for p in pieces) == sentence * 2
    assert pieces[-1].t == pytest.approx(1.0 + 80 * 10 / 9600)
    assert [p.last for p in pieces].count(True) == 2
    assert all(b.t > a.t for a, b in itertools.pairwise(pieces))


def test_a_terminal_nobody_reads_keeps_nothing(tmp_path):
    port = open_port(PtyPort(symlink=str(tmp_path / "tty")))
    port.send(b"old news")
    fd = os.open(tmp_path / "tty", os.O_RDWR | os.O_NOCTTY)
    port.send(b"news\r\n")
    assert os.read(fd, 100) == b"news\r\n"
    assert port.dropped_bytes == 8
    os.close(fd)
    port.close()


def test_a_terminal_with_a_stalled_reader_never_blocks(tmp_path):
    port = open_port(PtyPort(symlink=str(tmp_path / "tty")))
    fd = os.open(tmp_path / "tty", os.O_RDWR | os.O_NOCTTY)
    for _ in range(200):
        port.send(bytes(1000))
    assert 0 < port.dropped_bytes < 200_000
    os.close(fd)
    port.close()


def test_a_terminal_replaces_a_link_but_never_a_file(tmp_path):
    place = tmp_path / "tty"
    first, second = (open_port(PtyPort(symlink=str(place))) for _ in range(2))
    first.close()
    assert place.exists(), "the link is the second's now"
    second.close()
    place.write_text("precious")
    with pytest.raises(UsblnavError, match="exists and is no symlink"):
        open_port(PtyPort(symlink=str(place)))
    assert place.read_text() == "precious"


def test_a_real_serial_port_is_set_raw():
    near, far = os.openpty()
    port = open_port(SerialPort(port=os.ttyname(far), baud=115200))
    port.send(b"a\nb\r\n")
    assert os.read(near, 100) == b"a\nb\r\n"
    port.close()
    os.close(near)
    os.close(far)


def test_a_rate_no_uart_has():
    with pytest.raises(UsblnavError, match="12345 baud is not a rate"):
        open_port(SerialPort(port="/dev/null", baud=12345))


def test_tcp_serves_many_and_forgets_who_left():
    number = free_port()
    port = open_port(TcpServerPort(port=number))
    port.send(b"nobody")
    clients = [socket.create_connection(("127.0.0.1", number), 5.0) for _ in range(2)]
    port.send(b"one")
    assert [c.recv(10) for c in clients] == [b"one", b"one"]
    clients[0].close()
    while port.dropped_bytes == 6:
        port.send(b"two")
    assert clients[1].recv(3) == b"two"
    clients[1].close()
    port.close()
