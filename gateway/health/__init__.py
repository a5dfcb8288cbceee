"""How the gateway fares: its lines, what they say and cannot be right, and one report of it all."""

from gateway.health.lines import SILENT_S, Line
from gateway.health.report import DeviceReport, HealthReport
from gateway.health.watch import Health

__all__ = ["SILENT_S", "DeviceReport", "Health", "HealthReport", "Line"]
