"""From absolute pressure to depth below the surface, by a mean density or by latitude.

With a latitude: UNESCO 1983 (Fofonoff and Millard, Technical Papers in Marine Science 44), the
standard ocean of 35 psu at 0 deg C under gravity of latitude and depth; 9712.653 m at 10 000 dbar
and 30 deg. Without: the weight of a column of the given mean density.
"""

from math import radians, sin
from typing import Annotated

import msgspec
from msgspec import Meta

G0 = 9.80665
DBAR_PA = 1e4


class WaterColumn(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """What a pressure does not say: the air above the water, and the water.

    ``latitude_deg`` takes sea water of the standard ocean and leaves ``density_kg_m3`` unused;
    ``atmosphere_hpa`` is 0 for a sensor that was tared at the surface.
    """

    atmosphere_hpa: Annotated[float, Meta(ge=0, le=1100)] = 1013.25
    latitude_deg: Annotated[float, Meta(ge=-90, le=90)] | None = None
    density_kg_m3: Annotated[float, Meta(ge=900, le=1200)] = 1025.0

    def depth_m(self, pressure_pa: float) -> float:
        """Depth below the surface (m) at an absolute pressure; negative above the surface."""
        gauge_pa = pressure_pa - 100.0 * self.atmosphere_hpa
        if self.latitude_deg is None:
            return gauge_pa / (self.density_kg_m3 * G0)
        return _unesco(gauge_pa / DBAR_PA, self.latitude_deg)

    def pressure_pa(self, depth_m: float) -> float:
        """Absolute pressure at a depth: the inverse, to a micrometre."""
        pressure_pa = 100.0 * self.atmosphere_hpa + depth_m * self.density_kg_m3 * G0
        while abs(miss_m := depth_m - self.depth_m(pressure_pa)) > 1e-6:
            pressure_pa += miss_m * self.density_kg_m3 * G0
        return pressure_pa


def _unesco(p: float, latitude_deg: float) -> float:
    """Depth (m) at a gauge pressure (dbar)."""
    x = sin(radians(latitude_deg)) ** 2
    gravity = 9.780318 * (1.0 + (5.2788e-3 + 2.36e-5 * x) * x) + 1.092e-6 * p
    return (((-1.82e-15 * p + 2.279e-10) * p - 2.2512e-5) * p + 9.72659) * p / gravity
