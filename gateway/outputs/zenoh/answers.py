"""Answers to queries: the last word on a key at once, its past from a thread of its own.

Thousands of replies are given out in small portions: whatever holds the interpreter's lock for
longer is felt by navigation.
"""

import threading
import time
from collections.abc import Mapping
from contextlib import suppress

import zenoh

from gateway.outputs.background import NAME
from gateway.outputs.zenoh.past import Past, time_range
from gateway.outputs.zenoh.session import stamp

PORTION, PAUSE_S = 20, 0.001
"""Replies at once (0.1 ms), and the pause after them."""
AT_ONCE = 4
"""Queries for the past that are answered at the same time."""


class Answers:
    """What is given to who asks for the keys of a vehicle.

    Parameters
    ----------
    prefix
        Of the keys.
    past
        Reports by the last part of their key.
    source
        Of their timestamps.
    """

    def __init__(self, prefix: str, past: Mapping[str, Past], source: zenoh.TimestampId) -> None:
        self._source = source
        self._past = {f"{prefix}/{topic}": reports for topic, reports in past.items()}
        self._places = threading.BoundedSemaphore(AT_ONCE)

    def answer(self, query: zenoh.Query) -> None:
        """Reply to a query; called from a thread of Zenoh's, which waits for us."""
        asked = [key for key in self._past if query.key_expr.intersects(zenoh.KeyExpr(key))]
        wanted = query.parameters.get("_time")
        if wanted is None:
            with query:
                for key in asked:
                    self._reply(query, key, self._past[key].last)
            return
        try:
            first_ns, last_ns = time_range(wanted, time.time_ns())
        except ValueError as error:
            _refuse(query, f"_time: {error}")
            return
        if not self._places.acquire(blocking=False):
            _refuse(query, f"_time: {AT_ONCE} others are being answered; ask again")
            return
        work = (query, asked, first_ns, last_ns)
        threading.Thread(target=self._give, args=work, name=NAME, daemon=True).start()

    def _give(self, query: zenoh.Query, asked: list[str], first_ns: int, last_ns: int) -> None:
        """Reply with all that the range holds, each key's in order."""
        try:
            with query, suppress(zenoh.ZError):  # who asked may be gone
                for key in asked:
                    for n, report in enumerate(self._past[key].between(first_ns, last_ns)):
                        if n % PORTION == PORTION - 1:
                            time.sleep(PAUSE_S)
                        self._reply(query, key, report)
        finally:
            self._places.release()

    def _reply(self, query: zenoh.Query, key: str, report: tuple[int, bytes] | None) -> None:
        if report is not None:
            utc_ns, payload = report
            when = stamp(self._source, utc_ns)
            query.reply(key, payload, encoding=zenoh.Encoding.APPLICATION_JSON, timestamp=when)


def _refuse(query: zenoh.Query, why: str) -> None:
    with query:
        query.reply_err(why, encoding=zenoh.Encoding.TEXT_PLAIN)
