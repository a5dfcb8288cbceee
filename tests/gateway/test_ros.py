"""Messages of ROS 2, decoded by rosbags, against frames turned by scipy and by hand."""

import math
from typing import Any

import msgspec
import numpy as np
import pytest
import zenoh
from rosbags.typesys import Stores, get_typestore
from scipy.spatial.transform import Rotation
from zenoh import ext

from gateway.clock import ClockReport
from gateway.config import MapOrigin, ZenohRos
from gateway.filter_process.host import HostStatus
from gateway.health import DeviceReport, HealthReport
from gateway.health.report import LinkReport
from gateway.machine.realtime import RealtimeStatus
from gateway.modes import Mode
from gateway.nav.earth import radii
from gateway.outputs.ros import messages, names
from gateway.outputs.ros.cdr import CdrWriter
from gateway.outputs.schema import NavReport, nav_report
from gateway.outputs.sinks import SinkStatus
from tests.gateway.solutions import solution

ROS = get_typestore(Stores.ROS2_JAZZY)
OFFSET_NS = 1_700_000_000_123_456_789
HERE = ZenohRos(origin=MapOrigin(lat_deg=39.8, lon_deg=116.2, height_m=-50.25))
DEFAULTS = (0.0, 0.0, 0.0)


def decoded(data: bytes, kind: str) -> Any:
    message = ROS.deserialize_cdr(data, kind)
    # What the library writes of what it read is what we wrote, but for its own padding at the end.
    assert bytes(ROS.serialize_cdr(message, kind)).rstrip(b"\0") == data.rstrip(b"\0")
    return message


def nav(**changes: Any) -> NavReport:
    return msgspec.structs.replace(nav_report(solution(), OFFSET_NS), **changes)


def odometry(report: NavReport, settings: ZenohRos = HERE) -> Any:
    data = messages.Mapped(settings).odometry(report)
    assert data is not None
    return decoded(data, "nav_msgs/msg/Odometry")


def vector(xyz: Any) -> tuple[float, ...]:
    return (xyz.x, xyz.y, xyz.z)


def turned(orientation: Any) -> Rotation:
    return Rotation.from_quat((*vector(orientation), orientation.w))


def test_the_header_tells_the_time_of_validity_exactly() -> None:
    message = odometry(nav())
    stamp = message.header.stamp
    assert stamp.sec * 10**9 + stamp.nanosec == nav().utc_ns
    assert (message.header.frame_id, message.child_frame_id) == ("map", "base_link")


@pytest.mark.parametrize(
    ("heading_deg", "forward"),
    [(0.0, (0, 1, 0)), (90.0, (1, 0, 0)), (180.0, (0, -1, 0)), (270.0, (-1, 0, 0))],
)
def test_north_is_y_and_east_is_x(heading_deg: float, forward: tuple[float, ...]) -> None:
    report = nav(heading_deg=heading_deg, roll_deg=0.0, pitch_deg=0.0)
    pose = odometry(report).pose.pose
    assert turned(pose.orientation).apply((1, 0, 0)) == pytest.approx(forward, abs=1e-12)
    assert turned(pose.orientation).apply((0, 0, 1)) == pytest.approx((0, 0, 1), abs=1e-12)


def test_bow_up_and_starboard_down_in_axes_forward_left_up() -> None:
    bow_up = nav(heading_deg=90.0, roll_deg=0.0, pitch_deg=10.0)
    bow = turned(odometry(bow_up).pose.pose.orientation).apply((1, 0, 0))
    sine, cosine = math.sin(math.radians(10)), math.cos(math.radians(10))
    assert bow == pytest.approx((cosine, 0, sine))
    heeled = nav(heading_deg=90.0, roll_deg=10.0, pitch_deg=0.0)
    port = turned(odometry(heeled).pose.pose.orientation).apply((0, 1, 0))
    assert port == pytest.approx((0, cosine, sine))


@pytest.mark.parametrize("angles", [(0, 0, 0), (179, 5, 200), (-100, -60, 359), (10, 89, 45)])
def test_the_quaternion_is_scipys(angles: tuple[float, float, float]) -> None:
    C = Rotation.from_euler("ZYX", angles[::-1], degrees=True).as_matrix()
    assert turned(
        type("Q", (), dict(zip("xyzw", messages.quaternion(C), strict=True)))
    ).approx_equal(Rotation.from_matrix(C), atol=1e-12)


def test_position_is_east_north_up_of_the_origin() -> None:
    assert vector(odometry(nav()).pose.pose.position) == pytest.approx((0, 0, 0), abs=1e-6)
    meridian, prime_vertical = radii(math.radians(39.8))
    north, east = 120.0, 50.0
    there = nav(
        lat_deg=39.8 + math.degrees(north / (meridian - 50.25)),
        lon_deg=116.2
        + math.degrees(east / ((prime_vertical - 50.25) * math.cos(math.radians(39.8)))),
        height_m=-53.25,
    )
    assert vector(odometry(there).pose.pose.position) == pytest.approx((50, 120, -3), abs=5e-3)


def test_far_from_the_origin_the_axes_are_still_those_of_the_origin() -> None:
    report = nav(lat_deg=40.8, roll_deg=0.0, pitch_deg=0.0, heading_deg=0.0)
    pose = odometry(report).pose.pose
    bow = turned(pose.orientation).apply((1, 0, 0))
    assert math.degrees(math.asin(-bow[2])) == pytest.approx(1.0, abs=1e-6)
    assert pose.position.z < -900.0


def test_velocity_is_the_vehicles_own() -> None:
    report = nav(heading_deg=90.0, roll_deg=0.0, pitch_deg=0.0, vn_m_s=1.0, ve_m_s=2.0, vd_m_s=0.5)
    twist = odometry(report).twist
    assert vector(twist.twist.linear) == pytest.approx((2.0, 1.0, -0.5))
    covariance = twist.covariance.reshape(6, 6)
    sds = report.sd_ve_m_s, report.sd_vn_m_s, report.sd_vd_m_s
    assert np.sqrt(np.diag(covariance)[:3]) == pytest.approx(sds)
    assert vector(twist.twist.angular) == DEFAULTS
    assert np.diag(covariance)[3:] == pytest.approx([1e6] * 3)


def test_covariances_are_those_of_the_filter_turned() -> None:
    cov_ne = 0.05
    report = nav_report(solution(cov_ne=cov_ne), OFFSET_NS)
    pose = odometry(report).pose.covariance.reshape(6, 6)
    expected = np.diag((report.sd_e_m**2, report.sd_n_m**2, report.sd_d_m**2))
    expected[0, 1] = expected[1, 0] = cov_ne
    assert pose[:3, :3] == pytest.approx(expected, abs=1e-9)
    level = msgspec.structs.replace(report, roll_deg=0.0, pitch_deg=0.0, heading_deg=90.0)
    attitude = odometry(level).pose.covariance.reshape(6, 6)[3:, 3:]
    # Heading east: roll turns about x (east), pitch about y (north), heading about z.
    sds = np.radians((report.sd_roll_deg, report.sd_pitch_deg, report.sd_heading_deg))
    assert attitude == pytest.approx(np.diag(sds**2), abs=1e-12)


def test_the_fix_is_of_the_ellipsoid_with_its_covariance() -> None:
    report = nav_report(solution(cov_ne=0.05), OFFSET_NS)
    data = messages.Mapped(HERE).nav_sat_fix(report)
    fix = decoded(data, "sensor_msgs/msg/NavSatFix")
    assert (fix.latitude, fix.longitude, fix.altitude) == (
        report.lat_deg,
        report.lon_deg,
        report.height_m,
    )
    assert (fix.status.status, fix.position_covariance_type) == (0, 3)
    assert fix.header.frame_id == "base_link"
    covariance = fix.position_covariance.reshape(3, 3)
    assert np.sqrt(np.diag(covariance)) == pytest.approx((0.4, 0.3, 0.5))
    assert covariance[0, 1] == pytest.approx(0.05)


def imu(report: NavReport) -> Any:
    data = messages.Mapped(HERE).imu(report)
    assert data is not None
    return decoded(data, "sensor_msgs/msg/Imu")


def test_the_attitude_is_over_east_north_up_where_the_vehicle_is() -> None:
    report = nav(lat_deg=40.8, heading_deg=60.0, roll_deg=10.0, pitch_deg=20.0)
    message = imu(report)
    assert message.header.frame_id == "base_link"
    stamp = message.header.stamp
    assert stamp.sec * 10**9 + stamp.nanosec == report.utc_ns
    # By the words of REP-103: yaw from east to the left, bow up is pitch down, port up is roll.
    expected = Rotation.from_euler("ZYX", (90.0 - 60.0, -20.0, 10.0), degrees=True)
    assert turned(message.orientation).approx_equal(expected, atol=1e-12)


def test_the_attitudes_covariance_is_about_east_north_up() -> None:
    report = nav(roll_deg=0.0, pitch_deg=0.0, heading_deg=0.0)
    # Heading north: roll turns about y (north), pitch about x (east), heading about z.
    sds = np.radians((report.sd_pitch_deg, report.sd_roll_deg, report.sd_heading_deg))
    covariance = imu(report).orientation_covariance.reshape(3, 3)
    assert covariance == pytest.approx(np.diag(sds**2), abs=1e-12)


def test_what_an_imu_message_does_not_hold_is_marked() -> None:
    message = imu(nav())
    assert message.angular_velocity_covariance[0] == -1.0
    assert message.linear_acceleration_covariance[0] == -1.0
    assert vector(message.angular_velocity) == vector(message.linear_acceleration) == DEFAULTS


@pytest.mark.parametrize("mode", [Mode.ALIGNING, Mode.FAULT, Mode.INVALID])
def test_without_a_place_nothing_is_claimed(mode: Mode) -> None:
    mapped = messages.Mapped(HERE)
    assert mapped.odometry(nav(mode=mode)) is None
    assert mapped.imu(nav(mode=mode)) is None
    fix = decoded(mapped.nav_sat_fix(nav(mode=mode)), "sensor_msgs/msg/NavSatFix")
    assert (fix.status.status, fix.position_covariance_type) == (-1, 0)
    assert math.isnan(fix.latitude + fix.longitude + fix.altitude)


def device(silent_s: float | None, up: bool) -> DeviceReport:
    none = dict.fromkeys(("bytes", "measurements", "rejected_bytes", "missing"), 0)
    none |= dict.fromkeys(("refused_datagrams", "kernel_dropped", "gaps"), 0)
    return DeviceReport(
        kind="imu",
        codec="kvh1750",
        line="imu0",
        silent_s=silent_s,
        records=7,
        rejected={"length": 2},
        ignored={},
        link=LinkReport("udp", up, 1, 0, 0, {}),
        clock=ClockReport("arrival", None),
        **none,
    )


def test_diagnostics_say_what_the_status_says() -> None:
    status = HealthReport(
        vehicle="auv1",
        t_s=0.0,
        up_s=60.0,
        mode=Mode.DEAD_RECKONING,
        fix_age_s=12.5,
        devices={
            "imu0": device(0.1, up=True),
            "usbl0": device(9.0, up=False),
            "gnss0": device(None, up=True),
        },
        filter=HostStatus(1, 2, ready=True, restarts=1, waiting=0, kept=0, dropped=0, forgotten=0),
        totals=None,
        outputs=[SinkStatus("zenoh peer", up=False, sent=5, dropped=0, error="nobody answers")],
        latency=[],
        realtime=RealtimeStatus(),
        state_file=None,
    )
    data = messages.diagnostics(status, OFFSET_NS)
    array = decoded(data, "diagnostic_msgs/msg/DiagnosticArray")
    said = {entry.name: (entry.level, entry.message) for entry in array.status}
    assert said == {
        "auv1: navigation": (1, "dead_reckoning"),
        "auv1: filter": (0, "ready"),
        "auv1: imu0": (0, "up"),
        "auv1: usbl0": (2, "line lost"),
        "auv1: gnss0": (3, "not heard yet"),
        "auv1: zenoh peer": (1, "nobody answers"),
    }
    assert {entry.hardware_id for entry in array.status} == {"auv1"}
    values = {pair.key: pair.value for pair in array.status[2].values}
    assert values == {
        "codec": "kvh1750",
        "silent_s": "0.1",
        "records": "7",
        "gaps": "0",
        "rejected": "2",
    }


def test_cdr_aligns_from_behind_its_header() -> None:
    data = CdrWriter().number("B", 1).number("d", 2.0).text("ab").number("H", 3).finish()
    assert data[:4] == b"\0\1\0\0"
    assert data[4:].hex() == "01" + "00" * 7 + "0000000000000040" + "03000000616200" + "00" + "0300"


@pytest.mark.parametrize("store", [Stores.ROS2_IRON, Stores.ROS2_JAZZY, Stores.ROS2_KILTED])
@pytest.mark.parametrize("kind", [names.ODOMETRY, names.NAV_SAT_FIX, names.IMU, names.DIAGNOSTICS])
def test_hashes_are_those_of_the_definitions(store: Stores, kind: names.MessageType) -> None:
    known = get_typestore(store)
    assert known.hash_rihs01(f"{kind.package}/msg/{kind.name}") == kind.hash


TALKER = (
    "@ros2_lv/2/8b20917502ee955ac4476e0266340d5c/0/10/MP/%/%/usblnav/%chatter/"
    "std_msgs::msg::dds_::String_/"
    "RIHS01_df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18/::,10:,:,:,,"
)
"""As in docs/design.md of rmw_zenoh, but for the name of the node and its depth."""
STRING = names.MessageType("std_msgs", "String", TALKER.split("/")[-2])


def test_tokens_and_keys_are_those_of_rmw_zenoh() -> None:
    node = names.Node(2, "8b20917502ee955ac4476e0266340d5c", "")
    assert node.publisher_token(10, "/chatter", STRING) == TALKER
    assert node.token() == "@ros2_lv/2/8b20917502ee955ac4476e0266340d5c/0/0/NN/%/%/usblnav"
    assert node.key("/chatter", STRING) == f"2/chatter/std_msgs::msg::dds_::String_/{STRING.hash}"
    ours = names.Node(0, "8b", "fleet/auv1", hashes=False)
    assert ours.token() == "@ros2_lv/0/8b/0/0/NN/%/%fleet%auv1/usblnav"
    assert ours.key("/fleet/auv1/odometry", names.ODOMETRY) == (
        "0/fleet/auv1/odometry/nav_msgs::msg::dds_::Odometry_/TypeHashNotSupported"
    )


def test_a_publisher_is_known_by_the_hash_of_its_token() -> None:
    # As simplified_xxhash3.cpp of rmw_zenoh, compiled, makes it: low word first.
    assert names.identity(TALKER).hex() == "c582b70f3fffd7c7805c8af9b4c7fa03"


def test_a_bridge_is_told_of_topic_type_and_quality() -> None:
    # @/<session>/@ros2_lv/MP/<key>/<type>/<K if keyed>:<reliable>:<volatile>:<last>,<n>[:<data>]
    humble = names.Node(0, "8b", "auv1", hashes=False)
    assert humble.bridge_token("/auv1/odometry", names.ODOMETRY) == (
        "@/8b/@ros2_lv/MP/auv1§odometry/nav_msgs§msg§Odometry/:1:0:0,10"
    )
    jazzy = names.Node(0, "8b", "auv1")
    assert jazzy.bridge_token("/auv1/imu/data", names.IMU) == (
        f"@/8b/@ros2_lv/MP/auv1§imu§data/sensor_msgs§msg§Imu/:1:0:0,10:typehash={names.IMU.hash};"
    )


def test_the_attachment_has_sequence_time_and_identity() -> None:
    data = names.attachment(7, 1_700_000_000_123_456_789, bytes(range(16)))
    assert data[:8] == (7).to_bytes(8, "little")
    assert int.from_bytes(data[8:16], "little") == 1_700_000_000_123_456_789
    assert data[16:] == b"\x10" + bytes(range(16))
    # And as Zenoh's own serialization has it, in which the middleware reads it.
    read = ext.z_deserialize(tuple[ext.Int64, ext.Int64, bytes], zenoh.ZBytes(data))
    assert read == (7, 1_700_000_000_123_456_789, bytes(range(16)))


@pytest.mark.parametrize(
    ("vehicle", "name"), [("auv1", "auv1"), ("auv-1.b", "auv_1_b"), ("7", "_7")]
)
def test_a_vehicles_name_becomes_one_of_ros(vehicle: str, name: str) -> None:
    assert names.namespace_of(vehicle) == name
