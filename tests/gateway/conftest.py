"""Fixtures of several files."""

import logging
from collections.abc import Callable

import pytest


@pytest.fixture
def said(caplog: pytest.LogCaptureFixture) -> Callable[[], list[str]]:
    """Takes what was logged since it was last asked."""
    caplog.set_level(logging.INFO)

    def take() -> list[str]:
        lines = list(caplog.messages)
        caplog.clear()
        return lines

    return take
