"""Every alarm has its line in docs/operations.md, and no line is of an alarm that is not there."""

import re

from tests.shared_data import ROOT


def test_every_alarm_is_in_the_table() -> None:
    sources = ("gateway/monitor/alarms.py", "gateway/monitor/heard.py")
    code = "\n".join((ROOT / name).read_text(encoding="utf-8") for name in sources)
    named = re.findall(r'(?:Alarm\(\s*\w[\w.]*, |Severity\.\w+, )"([a-z ]+)"', code)
    table = re.findall(r"^\| \*\*([a-z ]+)\*\*", (ROOT / "docs/operations.md").read_text(), re.M)
    assert len(table) == len(set(table))
    assert set(named) == set(table)
