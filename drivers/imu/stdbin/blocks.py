"""The blocks of STDBIN that are used: their keys, and how their numbers are written.

Navigation blocks that are used (navigation N, extended E), all f32 but for the bit masks:

===== =============================================================================
N0    heading, roll (port up), pitch (bow down) (deg)
N1    their standard deviations (deg)
N5    rotation rate (deg/s), less that of the Earth
N6    acceleration (m/s^2), less gravity
N25   mean temperature of gyros, of accelerometers, of the board (degC)
N28   acceleration (m/s^2) as sensed, gravity in it, at the lever arm
E2    rotation rate (deg/s) as sensed, the Earth's in it
===== =============================================================================

External blocks, each with its own time i32 (100 us of the day):

====== ============================================================================
1-3    GNSS: id u8, quality u8, lat, lon f64 (deg), altitude above the geoid, sigma lat, lon,
       altitude, covariance, geoid above the ellipsoid, f32
6-8    USBL: id u8, beacon 8 chars, lat, lon f64, altitude, sigma N, E, covariance, sigma altitude
9      depth (m), sigma
10 21  DVL over the bottom: id u8, v1 v2 v3 (m/s), sound speed, altitude, sigma 1 2 3
11 22  DVL through water: id u8, v1 v2 v3, sound speed, sigma 1 2 3
14-17  LBL: u8, beacon 8 chars, lat, lon f64, altitude, range (m), sigma
====== ============================================================================

Vehicle axes are 1 forward, 2 port, 3 up; inertial samples stay in them.
"""

from struct import Struct

from drivers.imu.stdbin.layout import Kind

TICK_S = 1e-4
DAY_TICKS = 864_000_000
AGE_MAX_TICKS = 600_000
"""An external block that is older than a minute, or of tomorrow, has another clock (100 us)."""

HEADING, HEADING_SD, TURNING, MOVING, TEMPERATURES, FORCE = (
    Kind.NAVIGATION + bit for bit in (0, 1, 5, 6, 25, 28)
)
RATE = Kind.EXTENDED + 2
GNSS, USBL, DEPTH, BOTTOM, WATER, LBL = (Kind.EXTERNAL + bit for bit in (1, 6, 9, 10, 11, 14))
MANUAL_GNSS = 2

VECTOR = Struct(">3f")
GNSS_BLOCK = Struct(">iBBdd6f")
USBL_BLOCK = Struct(">iB8sdd5f")
DEPTH_BLOCK = Struct(">iff")
BOTTOM_BLOCK = Struct(">iB8f")
WATER_BLOCK = Struct(">iB7f")
LBL_BLOCK = Struct(">iB8sdd3f")
