"""The scenario file: one vehicle's true motion, instruments, their errors and the wires they use.

Where a block says the same thing as in the gateway's configuration it is the very same block, so
`gateway.emulator.twin` can give the configuration that matches a scenario.
"""

from gateway.emulator.scenario.acoustic import (
    LblErrors,
    LblModel,
    Message,
    Outliers,
    ToldTime,
    UsblErrors,
    UsblModel,
)
from gateway.emulator.scenario.aiding import (
    AidingModel,
    DepthModel,
    DvlErrors,
    DvlModel,
    GnssModel,
    HeadingModel,
)
from gateway.emulator.scenario.file import DeviceModel, Initial, Mobile, Scenario, codec_options
from gateway.emulator.scenario.grades import GRADES, Grade, Sheet
from gateway.emulator.scenario.imu import ImuErrors, ImuModel, Warming
from gateway.emulator.scenario.ports import AnyPort, PtyPort, SerialPort, TcpServerPort, UdpPort
from gateway.emulator.scenario.trajectory import (
    Circle,
    Lawnmower,
    Legs,
    Line,
    Spiral,
    Sway,
    Track,
    Transit,
    Wave,
    Waypoint,
    Waypoints,
)

__all__ = [
    "GRADES",
    "AidingModel",
    "AnyPort",
    "Circle",
    "DepthModel",
    "DeviceModel",
    "DvlErrors",
    "DvlModel",
    "GnssModel",
    "Grade",
    "HeadingModel",
    "ImuErrors",
    "ImuModel",
    "Initial",
    "Lawnmower",
    "LblErrors",
    "LblModel",
    "Legs",
    "Line",
    "Message",
    "Mobile",
    "Outliers",
    "PtyPort",
    "Scenario",
    "SerialPort",
    "Sheet",
    "Spiral",
    "Sway",
    "TcpServerPort",
    "ToldTime",
    "Track",
    "Transit",
    "UdpPort",
    "UsblErrors",
    "UsblModel",
    "Warming",
    "Wave",
    "Waypoint",
    "Waypoints",
    "codec_options",
]
