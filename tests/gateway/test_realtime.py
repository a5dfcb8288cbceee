"""What the system grants and refuses, in processes of their own."""

import os
import resource
import subprocess
import sys

import pytest

from gateway.machine import realtime

REFUSED = """
import os, resource
from gateway.machine import realtime
from gateway.config import Realtime
resource.setrlimit(resource.RLIMIT_RTPRIO, (0, 0))
resource.setrlimit(resource.RLIMIT_MEMLOCK, (4096, 4096))
if os.getuid() == 0:
    os.setresuid(65534, 65534, 65534)
status, complaints = realtime.enter(Realtime(priority=20, lock_memory=True, wake_us=0))
assert status == realtime.RealtimeStatus(0, False, None), status
print("\\n".join(complaints))
"""

GRANTED = """
import os, subprocess, sys, threading
from gateway.machine import realtime
from gateway.config import Realtime
status, complaints = realtime.enter(Realtime(priority=20, lock_memory=True))
assert (status, complaints) == (realtime.RealtimeStatus(20, True), []), (status, complaints)
assert "VmLck:\\t       0 kB" not in open("/proc/self/status").read()
policies = []
def look():
    policies.append(os.sched_getscheduler(0))
thread = threading.Thread(target=look)
thread.start()
thread.join()
assert policies == [os.SCHED_FIFO]
child = [sys.executable, "-c", "import os; print(os.sched_getscheduler(0))"]
with realtime.ordinary():
    assert int(subprocess.check_output(child)) == os.SCHED_OTHER
assert os.sched_getscheduler(0) == os.SCHED_FIFO
assert os.sched_getparam(0).sched_priority == 20
"""

AWAKE = """
import struct
from gateway.machine import realtime
from gateway.config import Realtime
def bound():
    with open("/dev/cpu_dma_latency", "rb") as file:
        return struct.unpack("i", file.read(4))[0]
assert bound() > 20
status, complaints = realtime.enter(Realtime(wake_us=20))
assert (status.wake_us, complaints) == (20, []), (status, complaints)
assert bound() == 20
"""

NOTHING_ASKED = """
import os
from gateway.machine import realtime
from gateway.config import Realtime
assert realtime.enter(Realtime()) == (realtime.RealtimeStatus(), [])
with realtime.ordinary():
    assert os.sched_getscheduler(0) == os.SCHED_OTHER
"""

COLLECTED = """
import gc, time, weakref
from gateway.machine import realtime
class Node: pass
collector = realtime.Collector()
collector.quiet()
assert gc.isenabled()
collector.settle()
assert not gc.isenabled() and gc.get_freeze_count() > 1000
node = Node()
node.itself = node
alive = weakref.ref(node)
del node
begun = time.monotonic()
while alive() is not None:
    collector.quiet()
assert time.monotonic() - begun >= realtime.COLLECT_S - 0.1
"""


def run(script: str) -> str:
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, timeout=60
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def may_be_punctual() -> bool:
    limits = (
        resource.getrlimit(resource.RLIMIT_RTPRIO)[0],
        resource.getrlimit(resource.RLIMIT_MEMLOCK)[0],
    )
    return os.getuid() == 0 or (limits[0] >= 20 and limits[1] == resource.RLIM_INFINITY)


def test_what_is_refused_is_a_line_each_and_no_more() -> None:
    lines = run(REFUSED).splitlines()
    assert len(lines) == 3
    assert "realtime.priority: 20 is not permitted (LimitRTPRIO=" in lines[0]
    assert lines[1].startswith("realtime.lock_memory: ")
    assert "LimitMEMLOCK=" in lines[1]
    assert lines[2].startswith("realtime.wake_us: /dev/cpu_dma_latency: ")


@pytest.mark.skipif(not may_be_punctual(), reason="no permission for real-time scheduling")
def test_what_is_granted_holds_for_threads_and_not_for_processes_started_as_ordinary() -> None:
    run(GRANTED)


@pytest.mark.skipif(
    not os.access(realtime.WAKING, os.R_OK | os.W_OK), reason="no permission for it"
)
def test_idle_cores_are_kept_from_sleeping_deeply() -> None:
    run(AWAKE)


def test_who_asks_for_nothing_gets_nothing() -> None:
    run(NOTHING_ASKED)


def test_garbage_is_collected_when_it_is_due_and_called_for() -> None:
    run(COLLECTED)
