"""Records how an autopilot follows the setpoints that Foxhound sends: steps, stops, turns and reversals, or yaw rates.

    python3 examples/step_response.py ardupilot tcp:127.0.0.1:5762        # out/step_response.csv
    python3 examples/step_response.py px4 udpin:127.0.0.1:14540 --repeats 4 --speeds 1 3 5 --mean out/mean.csv
    python3 examples/step_response.py px4 udpin:127.0.0.1:14540 --repeats 4 --yaw-rates 1 4 --mean out/yaw.csv

It is pilot and companion in one: arms, takes off, enters GUIDED or OFFBOARD, streams SET_POSITION_TARGET_LOCAL_NED
at 20 Hz with mask 0x05C7 (velocity and yaw rate), and lands. For a simulated autopilot only: nothing looks for
obstacles. Every repeat flies in another direction, or yaws to the other side. Needs pymavlink.

Rows of the CSV: `command` (sent), `estimate` (LOCAL_POSITION_NED) and `truth` (of the simulator: SIM_STATE of
ArduPilot, HIL_STATE_QUATERNION of PX4; its position is relative to its first row). Estimates are at the autopilot's
time, shifted by the least delay seen nearby; commands and truth at the time of sending and arrival.
`--mean` writes the truth every 0.1 s, along and across the direction of the repeat, as a mean of all repeats; of yaw
rates every 0.05 s the angle since the beginning, to the side of the repeat.
"""

import argparse
import csv
import math
import os
import sys
import time
from pathlib import Path

os.environ["MAVLINK20"] = "1"
from pymavlink import mavutil  # noqa: E402

MAV = mavutil.mavlink
NAN = float("nan")
PERIOD_S = 0.05
MASK = 0x05C7
HEIGHT_M = 6.0
TURN_MPS = 2.0
STEP_S, STOP_S = 6.0, 6.0
YAW_STEP_S, YAW_STOP_S = 3.0, 2.0
MEAN_S, YAW_MEAN_S = 0.1, 0.05
EARTH_M_PER_DEG = 111_318.8
# Main and sub mode of DO_SET_MODE, and what HEARTBEAT then shows.
FOLLOW = {"ardupilot": (4, 0, 4), "px4": (6, 0, 6 << 16)}
LAND = {"ardupilot": (9, 0, 9), "px4": (4, 6, 4 << 16 | 6 << 24)}
TRUTH = {"ardupilot": MAV.MAVLINK_MSG_ID_SIM_STATE, "px4": MAV.MAVLINK_MSG_ID_HIL_STATE_QUATERNION}


class Vehicle:
    """The link, and everything that came over it."""

    def __init__(self, kind, address):
        self.kind = kind
        self.link = mavutil.mavlink_connection(address, source_system=255, source_component=190, autoreconnect=True)
        self.begin_s = time.monotonic()
        self.beat = self.place = self.home = None
        self.is_ready = False
        self.acks, self.texts = {}, []
        self.next_beat_s = self.next_setpoint_s = 0.0
        self.velocity = None
        self.yaw_rate_radps = 0.0
        self.leg = "wait"
        self.commands, self.truths, self.estimates, self.begins_s = [], [], [], []

    def now(self):
        return time.monotonic() - self.begin_s

    def pump(self, seconds):
        """Sends what is due and reads what comes, for this long."""
        end_s = self.now() + seconds
        while (now_s := self.now()) < end_s:
            if now_s >= self.next_beat_s:
                self.next_beat_s = now_s + 1
                self.link.mav.heartbeat_send(MAV.MAV_TYPE_GCS, MAV.MAV_AUTOPILOT_INVALID, 0, 0, MAV.MAV_STATE_ACTIVE)
            if self.velocity is not None and now_s >= self.next_setpoint_s:
                self.next_setpoint_s = max(self.next_setpoint_s + PERIOD_S, now_s)
                self.send_setpoint(now_s)
            wait_s = min(end_s, self.next_setpoint_s if self.velocity else end_s) - self.now()
            message = self.link.recv_match(blocking=True, timeout=min(max(wait_s, 0.0005), 0.05))
            if message is not None:
                self.take(message)

    def send_setpoint(self, now_s):
        north, east = self.velocity
        system, boot_ms = self.beat.get_srcSystem(), int(now_s * 1e3)
        frame, velocity = MAV.MAV_FRAME_LOCAL_NED, (north, east, 0)
        self.link.mav.set_position_target_local_ned_send(
            boot_ms, system, 1, frame, MASK, 0, 0, 0, *velocity, 0, 0, 0, 0, self.yaw_rate_radps
        )
        self.commands.append((now_s, self.leg, (NAN, NAN, NAN), (north, east, 0.0), (NAN, self.yaw_rate_radps)))

    def take(self, message):
        now_s, kind = self.now(), message.get_type()
        if kind == "BAD_DATA" or message.get_srcComponent() != 1:
            return
        if kind == "HEARTBEAT":
            self.beat = message
        elif kind == "SYS_STATUS":
            self.is_ready = bool(message.onboard_control_sensors_health & MAV.MAV_SYS_STATUS_PREARM_CHECK)
        elif kind == "COMMAND_ACK":
            self.acks[message.command] = message.result
        elif kind == "STATUSTEXT":
            self.texts.append(message.text)
        elif kind == "LOCAL_POSITION_NED":
            self.place = message
            position, velocity = (message.x, message.y, message.z), (message.vx, message.vy, message.vz)
            self.estimates.append((now_s, message.time_boot_ms * 1e-3, self.leg, position, velocity, (NAN, NAN)))
        elif kind == "SIM_STATE":
            position = message.lat_int * 1e-7, message.lon_int * 1e-7, message.alt
            yaw = message.yaw, message.zgyro
            self.truth(now_s, position, (message.vn, message.ve, message.vd), yaw)
        elif kind == "HIL_STATE_QUATERNION":
            position = message.lat * 1e-7, message.lon * 1e-7, message.alt * 1e-3
            w, x, y, z = message.attitude_quaternion
            yaw = math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z)), message.yawspeed
            self.truth(now_s, position, (message.vx * 0.01, message.vy * 0.01, message.vz * 0.01), yaw)

    def truth(self, now_s, geographic, velocity, yaw):
        self.home = self.home or geographic
        north_m = (geographic[0] - self.home[0]) * EARTH_M_PER_DEG
        east_m = (geographic[1] - self.home[1]) * EARTH_M_PER_DEG * math.cos(math.radians(self.home[0]))
        self.truths.append((now_s, self.leg, (north_m, east_m, self.home[2] - geographic[2]), velocity, yaw))

    def until(self, what, is_true, seconds):
        end_s = self.now() + seconds
        while not is_true():
            if self.now() > end_s:
                sys.exit(f"no {what} within {seconds} s; the autopilot said last: {self.texts[-4:]}")
            self.pump(0.05)
        print(f"[{self.now():6.1f} s] {what}", file=sys.stderr)

    def command(self, number, *values):
        values = (list(values) + [0.0] * 7)[:7]
        self.acks.pop(number, None)
        self.link.mav.command_long_send(self.beat.get_srcSystem(), 1, number, 0, *values)
        end_s = self.now() + 1.5
        while number not in self.acks and self.now() < end_s:
            self.pump(0.02)
        return self.acks.get(number)

    def enter(self, name, mode):
        main, sub, shown = mode

        def is_in():
            if self.beat.custom_mode != shown:
                self.command(MAV.MAV_CMD_DO_SET_MODE, MAV.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED, main, sub)
                self.pump(1.0)
            return self.beat.custom_mode == shown

        self.until(name, is_in, 20)

    def is_armed(self):
        return bool(self.beat.base_mode & MAV.MAV_MODE_FLAG_SAFETY_ARMED)

    def take_off(self):
        self.until("heartbeat", lambda: self.beat, 60)
        rates = {MAV.MAVLINK_MSG_ID_LOCAL_POSITION_NED: 50, MAV.MAVLINK_MSG_ID_SYS_STATUS: 2, TRUTH[self.kind]: 50}
        for message, rate_hz in rates.items():
            self.command(MAV.MAV_CMD_SET_MESSAGE_INTERVAL, message, 1e6 / rate_hz)
        self.until("pre-arm checks passed", lambda: self.is_ready and self.place, 120)
        if self.kind == "ardupilot":
            self.enter("GUIDED", FOLLOW[self.kind])
        else:  # its height of take-off is above the sea, so a parameter says it
            system, kind = self.beat.get_srcSystem(), MAV.MAV_PARAM_TYPE_REAL32
            self.link.mav.param_set_send(system, 1, b"MIS_TAKEOFF_ALT", HEIGHT_M, kind)
            self.pump(0.5)

        def arms():
            return self.is_armed() or self.command(MAV.MAV_CMD_COMPONENT_ARM_DISARM, 1) == MAV.MAV_RESULT_ACCEPTED

        self.until("armed", arms, 60)
        ground_m = self.place.z
        if self.kind == "ardupilot":
            self.command(MAV.MAV_CMD_NAV_TAKEOFF, 0, 0, 0, 0, 0, 0, HEIGHT_M)
        else:
            self.command(MAV.MAV_CMD_NAV_TAKEOFF, NAN, 0, 0, NAN, NAN, NAN, NAN)
        self.until("height reached", lambda: ground_m - self.place.z > HEIGHT_M - 0.4, 60)
        self.pump(4.0)
        self.velocity = (0.0, 0.0)
        self.pump(2.0)
        self.enter("in control", FOLLOW[self.kind])
        self.pump(4.0)

    def fly(self, leg, speed_mps, direction_deg, seconds):
        angle_rad = math.radians(direction_deg)
        self.leg = f"{leg} {speed_mps:g} {direction_deg:g}"
        self.velocity = (speed_mps * math.cos(angle_rad), speed_mps * math.sin(angle_rad))
        self.next_setpoint_s = self.now()
        self.pump(seconds)

    def turn(self, yaw_rate_radps, seconds):
        self.leg = f"yaw {yaw_rate_radps:g}"
        self.velocity, self.yaw_rate_radps = (0.0, 0.0), yaw_rate_radps
        self.next_setpoint_s = self.now()
        self.pump(seconds)

    def land(self):
        self.leg, self.velocity = "land", None
        self.enter("LAND", LAND[self.kind])
        self.until("landed", lambda: not self.is_armed(), 60)


def rows(vehicle):
    """All that was recorded, in the order of time."""
    # The least delay of the neighbours: a simulator's second may be a per cent longer than ours.
    delays_s = [now_s - boot_s for now_s, boot_s, *_ in vehicle.estimates]
    shifts_s = [min(delays_s[max(0, i - 50) : i + 50]) for i in range(len(delays_s))]
    found = [(now_s, "command", *rest) for now_s, *rest in vehicle.commands]
    found += [(now_s, "truth", *rest) for now_s, *rest in vehicle.truths]
    estimates = zip(vehicle.estimates, shifts_s, strict=True)
    found += [(boot_s + shift_s, "estimate", *rest) for (_, boot_s, *rest), shift_s in estimates]
    for time_s, source, leg, *vectors in sorted(found, key=lambda row: row[0]):
        yield [f"{time_s:.4f}", source, leg, *(f"{x:.4f}" for vector in vectors for x in vector)]


def mean_yaw(vehicle, repeats):
    """The truth of all repeats as one, to the side of each."""
    begins_s = vehicle.begins_s
    ends_s = [*begins_s[1:], vehicle.commands[-1][0]]
    period_s = min(end_s - begin_s for begin_s, end_s in zip(begins_s, ends_s, strict=True))
    sums = [[0.0] * 2 for _ in range(int(period_s / YAW_MEAN_S))]
    for repeat, begin_s in enumerate(begins_s):
        side = 1 - 2 * (repeat % 2)
        sent = [(now_s - begin_s, yaw[1]) for now_s, *_, yaw in vehicle.commands]
        true = [(now_s - begin_s, yaw[0]) for now_s, *_, yaw in vehicle.truths]
        angle_rad, at, command_at, first_rad = 0.0, 0, 0, None
        for step, total in enumerate(sums):
            now_s = step * YAW_MEAN_S
            while true[at + 1][0] < now_s:
                angle_rad += math.remainder(true[at + 1][1] - true[at][1], math.tau)
                at += 1
            while command_at + 1 < len(sent) and sent[command_at + 1][0] <= now_s + PERIOD_S / 2:
                command_at += 1
            (before_s, before_rad), (after_s, after_rad) = true[at], true[at + 1]
            share = (now_s - before_s) / (after_s - before_s)
            now_rad = angle_rad + share * math.remainder(after_rad - before_rad, math.tau)
            first_rad = now_rad if first_rad is None else first_rad
            total[0] += side * sent[command_at][1] / repeats
            total[1] += side * (now_rad - first_rad) / repeats
    for step, total in enumerate(sums):
        yield [f"{step * YAW_MEAN_S:.2f}", *(f"{x + 0.0:.4f}" for x in total)]


def mean(vehicle, repeats):
    """The truth of all repeats as one, in the frame of their directions."""
    begins_s = vehicle.begins_s
    ends_s = [*begins_s[1:], vehicle.commands[-1][0]]
    period_s = min(end_s - begin_s for begin_s, end_s in zip(begins_s, ends_s, strict=True))
    truth, at = vehicle.truths, 0
    sums = [[0.0] * 6 for _ in range(int(period_s / MEAN_S))]
    for repeat, begin_s in enumerate(begins_s):
        angle_rad = math.radians(360 * repeat / repeats)
        cosine, sine = math.cos(angle_rad), math.sin(angle_rad)
        first, command_at = None, 0
        for step, total in enumerate(sums):
            now_s = begin_s + step * MEAN_S
            while truth[at + 1][0] < now_s:
                at += 1
            until_s = now_s + PERIOD_S / 2
            while command_at + 1 < len(vehicle.commands) and vehicle.commands[command_at + 1][0] <= until_s:
                command_at += 1
            (before_s, _, *before), (after_s, _, *after) = truth[at], truth[at + 1]
            share = (now_s - before_s) / (after_s - before_s)
            pairs = zip(before[:2], after[:2], strict=True)
            place, speed = ([x + share * (y - x) for x, y in zip(*pair, strict=True)] for pair in pairs)
            first = first or place
            place = [x - y for x, y in zip(place, first, strict=True)]
            command = vehicle.commands[command_at][3]
            for i, (north, east, _) in enumerate((command, place, speed)):
                total[2 * i] += (north * cosine + east * sine) / repeats
                total[2 * i + 1] += (east * cosine - north * sine) / repeats
    for step, total in enumerate(sums):
        yield [f"{step * MEAN_S:.1f}", *(f"{x + 0.0:.3f}" for x in total)]


def write(path, header, lines):
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("w", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(header.split())
        writer.writerows(lines)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("autopilot", choices=sorted(FOLLOW))
    parser.add_argument("address", help="as pymavlink writes it")
    parser.add_argument("--speeds", type=float, nargs="+", default=[1, 2, 3, 4, 5], metavar="M/S")
    parser.add_argument("--yaw-rates", type=float, nargs="+", metavar="RAD/S", help="these, hovering, in place of speeds")
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--out", type=Path, default=Path("out/step_response.csv"))
    parser.add_argument("--mean", type=Path, help="the mean of the repeats as well")
    args = parser.parse_args()
    vehicle = Vehicle(args.autopilot, args.address)
    vehicle.take_off()
    for repeat in range(args.repeats):
        direction_deg = 360 * repeat / args.repeats
        vehicle.begins_s.append(vehicle.now())
        if args.yaw_rates:
            for rate_radps in args.yaw_rates:
                vehicle.turn(rate_radps * (1 - 2 * (repeat % 2)), YAW_STEP_S)
                vehicle.turn(0.0, YAW_STOP_S)
            continue
        for speed_mps in args.speeds:
            vehicle.fly("step", speed_mps, direction_deg, STEP_S)
            vehicle.fly("stop", 0, direction_deg, STOP_S)
        for leg, turned_deg in (("turn", 90), ("reverse", 180)):
            vehicle.fly("before", TURN_MPS, direction_deg, STEP_S)
            vehicle.fly(leg, TURN_MPS, direction_deg + turned_deg, STEP_S)
            vehicle.fly("stop", 0, direction_deg, STOP_S)
    vehicle.land()
    write(args.out, "time_s source leg north_m east_m down_m vn_mps ve_mps vd_mps yaw_rad yaw_rate_radps", rows(vehicle))
    if args.mean and args.yaw_rates:
        write(args.mean, "time_s command_radps yaw_rad", mean_yaw(vehicle, args.repeats))
    elif args.mean:
        header = "time_s command_along_mps command_across_mps along_m across_m along_mps across_mps"
        write(args.mean, header, mean(vehicle, args.repeats))
    counts = f"{len(vehicle.commands)} setpoints, {len(vehicle.estimates)} estimates, {len(vehicle.truths)} of truth"
    print(f"{args.out}: {counts}")


if __name__ == "__main__":
    main()
