"""From a measurement's message to its linearised model: which beacon, which noise, which past."""

from dataclasses import dataclass, field, replace

import numpy as np
from msgspec import structs
from numpy.typing import NDArray

from gateway.engine import Track
from gateway.fusion import (
    bottom_velocity,
    depth,
    heading,
    lbl,
    loose,
    position,
    radial_velocity,
    stationary,
    usbl,
    velocity,
)
from gateway.fusion.axes import told_axes
from gateway.fusion.errors import FAMILY, RIGHT, ErrorDefinition
from gateway.fusion.kalman import Linearised
from gateway.fusion.radial_velocity import Doppler
from gateway.fusion.ranging import Past
from gateway.fusion.robust import Kind as RobustKind
from gateway.fusion.state import State
from gateway.messages import (
    Acoustic,
    BeaconPlace,
    BeaconRange,
    BottomVelocity,
    Depth,
    Fix,
    HeadingFix,
    OfTheVehicle,
    PositionFix,
    RadialRate,
    Stationary,
    UsblFix,
    VelocityFix,
)
from gateway.nav.earth import C_en, ecef_to_lla, lla_to_ecef

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Transponder:
    """A moored beacon: ECEF position, turn-around time, and whether its range is two-way."""

    r_e: Array
    turnaround_s: float
    two_way: bool


@dataclass(frozen=True)
class Responder:
    """A beacon on something that moves: its turn-around time, and whether its range is two-way."""

    turnaround_s: float
    two_way: bool


@dataclass(frozen=True)
class AcousticArray:
    """An array of the vehicle.

    Attributes
    ----------
    sigma
        (3,) white noise of elevation, bearing (rad) and range (m).
    rate_sigma
        White noise of one element's radial rate (m/s).
    elements_u
        (k, 3) places of the elements in array axes (m).
    rates_by_element
        Whether radial rates are used one by one instead of as their mean.
    """

    geometry: usbl.ArrayGeometry
    sigma: Array
    rate_sigma: float = 0.05
    elements_u: Array = field(default_factory=lambda: np.zeros((1, 3)))
    rates_by_element: bool = False
    sensor_sd: tuple[float, float] = (0.0, 0.0)
    """White noise (rad) of level and heading of the instrument's own motion sensor."""
    goes_by_us: bool = False
    """Whether it turns and places its fixes by this gateway's solution instead."""


@dataclass(frozen=True)
class Mount:
    """How a sensor that is no array sits in the body: (3,) lever arm (m), (3, 3) mounting."""

    lever_b: Array
    C_bs: Array


AT_THE_IMU = Mount(np.zeros(3), np.eye(3))


@dataclass(frozen=True)
class Loose:
    """Acoustic fixes as positions, with one `sigma` (m) a component or, None, the fix's own."""

    sigma: float | None


@dataclass(frozen=True)
class Model:
    """All that the filter takes as known.

    Attributes
    ----------
    error
        The error definition in whose coordinates updates are made.
    q
        (4,) noise densities of the IMU, see `gateway.nav.covariance.predict`.
    gate
        Probability inside the chi-squared gate.
    echoes
        Share of echoes among the sound that passes it where it is wide, see `gateway.fusion.echo`.
    targets
        Beacons that say nothing of our own place.
    mounts
        By device; one that is not named sits at the IMU in the body's axes.
    loose
        None couples acoustic fixes tightly.
    robust, adaptive_noise
        See `gateway.fusion.robust`.
    """

    error: ErrorDefinition
    q: Array
    gate: float
    sound_speed: float
    arrays: dict[str, AcousticArray]
    beacons: dict[str, Transponder]
    targets: dict[str, Responder] = field(default_factory=dict)
    mounts: dict[str, Mount] = field(default_factory=dict)
    loose: Loose | None = None
    echoes: float = 0.02
    robust: RobustKind = "none"
    adaptive_noise: bool = False

    def mount(self, device: str) -> Mount:
        """Where a device sits."""
        return self.mounts.get(device, AT_THE_IMU)


def observe(model: Model, state: State, fix: Fix, track: Track) -> Linearised | str:
    """Linearise a measurement at the state of its time, or say in a word why it has no model."""
    match fix:
        case UsblFix() | BeaconPlace() | BeaconRange() | RadialRate():
            return _observe_sound(model, state, fix, track)
        case _:
            return _observe_vehicle(model.mount(fix.device), state, fix)


def error_for(model: Model, fix: Fix) -> ErrorDefinition:
    """The error in whose coordinates a measurement is linear wherever the vehicle is.  # (M.182)

    The configured one is for what is seen from the vehicle; what is measured in the Earth's axes
    would tell of the attitude by every step that the position made.
    """
    match fix:
        case PositionFix() | VelocityFix() | Depth():
            return FAMILY["additive"]
        case _:
            return model.error


def place(model: Model, state: State, fix: Fix, track: Track) -> Linearised | None:
    """A whole acoustic fix as the position that it gives, for errors of any size.  # (M.139)

    None for any other measurement.
    """
    if not isinstance(fix, UsblFix) or fix.horizontal:
        return None
    z = observe(replace(model, loose=Loose(None)), state, fix, track)
    if isinstance(z, str):
        return None
    if model.error.kind != RIGHT:
        return z
    array = model.arrays[fix.device]
    axes = told_axes(state, array.geometry.C_bu, fix.axes)
    assert axes is not None  # or there were no z
    return loose.turning_the_beacon(z, model.beacons[fix.beacon].r_e, axes.turning)


def settled(model: Model, state: State, fix: Fix) -> Fix | str:
    """A fix that was turned or placed by our own solution, as the array saw it.  # (M.164), (M.165)

    By the estimate of now, and once: told by an estimate, it would follow the one that it corrects.
    Any other fix stays as it is; in a word why one cannot be freed.
    """
    array = model.arrays.get(fix.device)
    if array is None or not array.goes_by_us:
        return fix
    match fix:
        case UsblFix(axes="level" | "north"):
            rows = (fix.elevation, fix.bearing)
            measured = np.array([np.nan if v is None else v for v in (*rows, None)])
            told = usbl.Sighting(measured, array.sigma, state.r_e, None, fix.axes)
            sight = usbl.turned_back(state, array.geometry, told)
            if sight is None:
                return "geometry"
            elevation, bearing = sight.measured[:2].tolist()
            return structs.replace(fix, elevation=elevation, bearing=bearing, axes="array")
        case BeaconPlace() if fix.beacon in model.beacons:
            return _from_above(array, model.beacons[fix.beacon].r_e, state, fix)
        case _:
            return fix


def _from_above(array: AcousticArray, beacon_e: Array, state: State, fix: BeaconPlace) -> UsblFix:
    """The fix that ends in a place, at the height of the chart."""
    _, _, height = ecef_to_lla(beacon_e)
    told_e = lla_to_ecef(fix.lat, fix.lon, float(height))
    lever_b = array.geometry.lever_b + state.lever_b
    C_eu = state.C_eb @ array.geometry.C_bu
    x, y, z = (C_eu.T @ (told_e - state.r_e - state.C_eb @ lever_b)).tolist()
    elevation, bearing = usbl.angles((x, y, z))
    range_m = float(np.sqrt(x * x + y * y + z * z))
    return UsblFix(fix.t_ns, fix.device, fix.beacon, elevation, bearing, range_m, horizontal=True)


def _observe_vehicle(mount: Mount, state: State, fix: OfTheVehicle) -> Linearised | str:
    """Linearise what a sensor says of the vehicle itself."""
    match fix:
        case PositionFix():
            return position.linearise(state, mount.lever_b, _place(fix))
        case VelocityFix():
            return velocity.linearise(state, mount.lever_b, _over_ground(fix))
        case Depth():
            return depth.linearise(state, mount.lever_b, fix.h, fix.sd)
        case BottomVelocity():
            over_bottom = bottom_velocity.OverBottom(np.array(fix.v), np.array(fix.sd))
            return bottom_velocity.linearise(state, mount.lever_b, mount.C_bs, over_bottom)
        case HeadingFix():
            return heading.linearise(state, mount.C_bs, fix.heading, fix.sd) or "geometry"
        case Stationary():
            return stationary.linearise(state, fix.sd)


def _observe_sound(model: Model, state: State, fix: Acoustic, track: Track) -> Linearised | str:
    """Linearise what an array heard of a beacon."""
    array, beacon = model.arrays.get(fix.device), model.beacons.get(fix.beacon)
    if array is None:
        return "unknown_device"
    if beacon is None:
        return "unknown_beacon"
    match fix:
        case UsblFix():
            transmit = departure(model, beacon, fix.t_ns, None, fix.slant_range, track)
            sight = _sighting(array, beacon, fix, transmit)
            look = _sighted_from_above if fix.horizontal else _sighted
            return look(model, state, array.geometry, sight)
        case BeaconPlace():
            return "place"
        case BeaconRange():
            sent, range_m = fix.t_transmit_ns, fix.slant_range
            transmit = departure(model, beacon, fix.t_ns, sent, range_m, track)
            reply = lbl.Reply(range_m, float(array.sigma[usbl.RANGE]), beacon.r_e, transmit)
            return lbl.linearise(state, array.geometry.lever_b, reply)
        case RadialRate():
            rates = np.array(fix.rates)
            doppler = Doppler(rates, array.rate_sigma, beacon.r_e, array.rates_by_element)
            z = radial_velocity.linearise(state, array.geometry, array.elements_u, doppler)
            return z or "elements"


def _sighting(
    array: AcousticArray, beacon: Transponder, fix: UsblFix, transmit: Past | None
) -> usbl.Sighting:
    """A fix as measured."""
    rows = (fix.elevation, fix.bearing, fix.slant_range)
    measured = np.array([np.nan if v is None else v for v in rows])
    return usbl.Sighting(
        measured, array.sigma, beacon.r_e, transmit, fix.axes, array.sensor_sd, fix.t_sd_s
    )


def _sighted(
    model: Model, state: State, geometry: usbl.ArrayGeometry, sight: usbl.Sighting
) -> Linearised | str:
    """Linearise a fix tightly or loosely."""
    if model.loose is None:
        return usbl.linearise(state, geometry, sight) or "geometry"
    return loose.linearise(state, geometry, sight, model.loose.sigma) or "geometry"


def _sighted_from_above(
    model: Model, state: State, geometry: usbl.ArrayGeometry, sight: usbl.Sighting
) -> Linearised | str:
    """Linearise north and east of a fix whose down is the chart's.  # (M.165)"""
    sigma_m = None if model.loose is None else model.loose.sigma
    z = loose.linearise(state, geometry, sight, sigma_m)
    return (z and Linearised(z.residual[:2], z.H[:2], z.R[:2, :2], z.names[:2])) or "geometry"


def departure(
    model: Model,
    beacon: Transponder | Responder,
    t_ns: int,
    t_transmit_ns: int | None,
    slant_range: float | None,
    track: Track,
) -> Past | None:
    """The moment the ping left: as stated, else as long before as the range tells."""
    if not beacon.two_way:
        return None
    if t_transmit_ns is not None:
        return past(track, t_ns, (t_ns - t_transmit_ns) * 1e-9)
    if slant_range is None:
        return None
    return past(track, t_ns, 2.0 * slant_range / model.sound_speed + beacon.turnaround_s)


def _place(fix: PositionFix) -> position.Place:
    """Without a height the fix lies on the ellipsoid and says nothing about down."""
    h, sd_down = (0.0, np.inf) if fix.h is None else (fix.h, fix.sd[2])
    r_e = lla_to_ecef(fix.lat, fix.lon, h)
    return position.Place(r_e, C_en(fix.lat, fix.lon), np.array([*fix.sd[:2], sd_down]))


def _over_ground(fix: VelocityFix) -> velocity.OverGround:
    """Without a vertical velocity the fix says nothing about down."""
    down, sd_down = (0.0, np.inf) if fix.down is None else (fix.down, fix.sd[2])
    v_n, sigma = np.array([fix.north, fix.east, down]), np.array([*fix.sd[:2], sd_down])
    return velocity.OverGround(v_n, sigma)


def past(track: Track, t_ns: int, age_s: float) -> Past:
    """The moment `age_s` before `t_ns`."""
    row = track.at(t_ns - round(age_s * 1e9))
    return Past(row[:3], row[3:].reshape(3, 3), age_s)
