"""One page that a survey party files: what a replay or a recording shows of the navigation."""

from gateway.report.page import text, write
from gateway.report.source import Source, read

__all__ = ["Source", "read", "text", "write"]
