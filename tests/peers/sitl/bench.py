"""Around the pilot of `flight.py`: autopilot and companion as processes, their links, the tap between them, the simulator's truth."""

import json
import math
import os
import pathlib
import random
import select
import signal
import socket
import stat
import struct
import subprocess
import time

os.environ["MAVLINK20"] = "1"
from pymavlink.dialects.v20 import ardupilotmega as mavlink  # noqa: E402

HOME = (47.397742, 8.545594)
ALTITUDE = 488
METRES_PER_RAD = 6371000
# The posts that ArduPilot's simulated lidar sees (SIM_PS_RPLidar; SITL.cpp, measure_distance_at_angle_bf): every 10 m, one of them
# so far north and east of an origin; their radius, and ArduPilot's metres in a degree.
LIDAR_ORIGIN, LIDAR_FIRST_M, LIDAR_EVERY_M, LIDAR_POST_M = (51.8752066, 14.6487830), (3.0, 2.0), 10.0, 1.0
LIDAR_METRES_PER_DEG = 111319.5
PAD_M = 0.25
HEIGHT_M = 5.0
HULL_M = 0.15
SCAN_RANGE_M = 6.0
# The companion's options, and `FH_YAWR_MAX`.
SPEED_MAX_MPS, CLIMB_MAX_MPS, TURN_MAX_RADPS = 2.0, 0.5, 1.25
KEY = bytes.fromhex("00112233445566778899aabbccddeeff0123456789abcdeffedcba9876543210")
EPOCH_S = 1420070400  # 2015-01-01, from which signatures count
ARMED = mavlink.MAV_MODE_FLAG_SAFETY_ARMED
# Custom modes as HEARTBEAT has them; PX4 keeps its main mode in bits 16 to 23 and the sub mode in bits 24 to 31. ArduCopter holds in
# BRAKE: LOITER would follow the simulated throttle stick down.
MODES = {
    "ardupilot": {"give": 4, "hold": 17},
    "px4": {"give": 6 << 16, "hold": 4 << 16 | 3 << 24},
}
# The heartbeat tells of a mode this much later than the autopilot has it, at most.
MODE_KNOWN_S = 1.2


class Failed(Exception):
    """The flight cannot go on."""


class Skipped(Exception):
    """The autopilot cannot fly this cell."""


class Frames:
    """The frames in a stream of bytes."""

    def __init__(self):
        self.parser = mavlink.MAVLink(None)
        self.parser.robust_parsing = True

    def of(self, data):
        try:
            return [m for m in self.parser.parse_buffer(data) or [] if m.get_type() != "BAD_DATA"]
        except mavlink.MAVError:
            return []


class Bench:
    """One flight's processes and links, and what is measured on them."""

    def __init__(self, spec):
        self.spec = spec
        self.kind, self.n = spec["autopilot"], spec["instance"]
        # A cell that is flown by the firmware is that of the same name.
        self.cell = spec["cell"].removesuffix("_qemu")
        self.dir = pathlib.Path(spec["folder"])
        self.modes = MODES[self.kind]
        self.random = random.Random(spec["seed"])
        self.began = time.monotonic()
        self.log = (self.dir / "pilot.log").open("w")
        self.track = (self.dir / "track.csv").open("w")
        print("t,north,east,height,speed,yaw,seen_north,seen_east,seen_height,seen_vn,seen_ve", file=self.track)
        self.caller = [0] if stat.S_ISFIFO(os.fstat(0).st_mode) else []
        self.processes = {}
        self.companion_starts = 0
        self.has_taken_off = False
        self.least_at = 0.0
        self.mav = mavlink.MAVLink(None, srcSystem=255, srcComponent=190)
        self.sensor = mavlink.MAVLink(None, srcSystem=1, srcComponent=mavlink.MAV_COMP_ID_OBSTACLE_AVOIDANCE)
        self.pilot = self.up = self.down = self.listener = None
        self.companion_at = None
        self.beat = self.estimate = self.truth = self.landed = None
        self.ready = self.dropped = False
        self.acks, self.parameters, self.texts, self.told = {}, {}, [], []
        self.next_beat = self.next_scan = self.next_wind = 0.0
        self.offset = None
        # Of the tap.
        self.mode_at = 0.0
        self.in_control_since = None
        self.setpoint_at = self.setpoint = None
        self.moved_at = None
        self.count = {"setpoints": 0, "stray": 0, "over": 0, "unsigned": 0, "reentries": 0, "given_back": 0}
        self.longest_gap_s = self.clearance_m = self.seen_clearance_m = self.off_m = None
        self.lay_course()

    # -- the course --

    def lay_course(self):
        """A beacon 12 m away, 20 m where a fault needs time, and posts (north, east, radius) on the way there, in the autopilot's frame."""
        self.home, self.pad = HOME, None
        if self.cell == "lidar":
            self.lay_lidar_course()
            return
        bearing = self.random.uniform(-math.pi, math.pi)
        away = 20.0 if self.cell in ("gps_glitch", "ekf_reset", "wind") else 12.0
        ahead, right = (math.cos(bearing), math.sin(bearing)), (-math.sin(bearing), math.cos(bearing))
        place = lambda along, aside: tuple(along * a + aside * r for a, r in zip(ahead, right))
        self.beacon = place(away, 0.0)
        alongs = [3.5 + 2.4 * i for i in range(int((away - 4.0) / 2.4) + 1)]
        self.posts = [
            (*place(along + self.random.uniform(-0.4, 0.4), self.random.uniform(-1.3, 1.3)), self.random.uniform(0.1, 0.3))
            for along in alongs
        ]
        if self.lands():  # it asks for no landing beside something
            self.posts = [post for post in self.posts if math.dist(post[:2], self.beacon) > 1.5]
        posts = [{"x": east, "y": north, "r": r} for north, east, r in self.posts]
        (self.dir / "posts.json").write_text(json.dumps({"obstacles": posts}))
        if self.cell == "pad":
            self.pad = tuple(along + self.random.uniform(-0.5, 0.5) for along in self.beacon)

    def lay_lidar_course(self):
        """From about the middle of four of the lidar's posts to that of four others, past the one between them."""
        middle = [first + LIDAR_EVERY_M / 2 + self.random.uniform(-1.0, 1.0) for first in LIDAR_FIRST_M]
        latitude = LIDAR_ORIGIN[0] + middle[0] / LIDAR_METRES_PER_DEG
        per_deg = (LIDAR_METRES_PER_DEG, LIDAR_METRES_PER_DEG * math.cos(math.radians(latitude)))
        self.home = (latitude, LIDAR_ORIGIN[1] + middle[1] / per_deg[1])
        # As `see` measures.
        scale = math.radians(METRES_PER_RAD) / LIDAR_METRES_PER_DEG
        numbers = range(-3, 5)
        self.posts = [
            (scale * (n * LIDAR_EVERY_M + LIDAR_FIRST_M[0] - middle[0]), scale * (e * LIDAR_EVERY_M + LIDAR_FIRST_M[1] - middle[1]), LIDAR_POST_M)
            for n in numbers
            for e in numbers
        ]
        self.beacon = tuple(self.random.choice((-1, 1)) * (LIDAR_EVERY_M + self.random.uniform(-1.0, 1.0)) for _ in range(2))

    def lands(self):
        return self.cell in ("landing", "pad")

    def sees_file(self):
        return self.cell in ("calm", "signing")

    # -- processes --

    def start(self, name, command, **more):
        out = (self.dir / f"{name}.log").open("ab")
        more.setdefault("stdout", out)
        self.say("starts", name)
        self.processes[name] = subprocess.Popen(command, stderr=out, stdin=subprocess.DEVNULL, **more)

    def has_ended(self):
        companion = self.processes.get("companion")
        return companion is None or companion.poll() is not None

    def kill(self, name):
        process = self.processes.pop(name)
        process.kill()
        process.wait()
        self.say("killed", name)

    def start_autopilot(self):
        binary, files = self.spec["binary"], self.spec["parameters"]
        state = self.dir / self.kind
        state.mkdir(exist_ok=True)
        if self.kind == "ardupilot":
            arguments = ["--model", "quad", "-I", str(self.n), "--home", f"{self.home[0]:.9f},{self.home[1]:.9f},{ALTITUDE},0"]
            if self.cell == "lidar":
                arguments += ["--serial5", "sim:rplidara2"]
                own = self.dir / "lidar.parm"
                # Every other flight without ArduPilot's own avoidance by its sensor, which stops short of what it sees.
                own.write_text(f"SERIAL5_PROTOCOL 11\nPRX1_TYPE 5\nAVOID_ENABLE {7 if self.spec['seed'] % 2 else 5}\n")
                files = [*files, str(own)]
            arguments += ["--defaults", ",".join(files), "--serial0", "tcp:0"]
            wipe = [] if any(state.iterdir()) else ["--wipe"]
            self.start("autopilot", [binary, *arguments, *wipe], cwd=state)
        else:
            home = {"PX4_HOME_LAT": self.home[0], "PX4_HOME_LON": self.home[1], "PX4_HOME_ALT": ALTITUDE}
            values = {f"PX4_PARAM_{name}": value for file in files for name, value in px4_values(file)}
            if self.cell == "signing":
                (state / "mavlink").mkdir(exist_ok=True)
                (state / "mavlink/mavlink-signing-key.bin").write_bytes(KEY + struct.pack("<Q", signing_time()))
                values["PX4_PARAM_MAV_SIGN_CFG"] = 2
            given = {name: str(value) for name, value in {**home, **values, "PX4_SIM_MODEL": "sihsim_quadx"}.items()}
            etc = pathlib.Path(binary).parent.parent / "etc"
            command = [binary, "-i", str(self.n), "-d", "-w", str(state), str(etc)]
            self.start("autopilot", command, cwd=state, env=os.environ | given)
        self.beat = self.estimate = self.truth = None
        self.ready = False
        self.open_links()

    def start_companion(self):
        self.companion_starts += 1
        if self.kind == "ardupilot":
            address = f"tcp:127.0.0.1:{self.listener.getsockname()[1]}"
        else:
            address = f"udpin:127.0.0.1:{self.companion_at[1]}"
        north, east = self.beacon
        down = 0.0 if self.lands() else -HEIGHT_M
        command = [self.spec["foxhound"], "companion", "--json", "--autopilot", address, f"--source={north:.3f},{east:.3f},{down}"]
        command += ["--seed", str(self.spec["seed"]), "--max-time", "220", "--tlog", str(self.dir / f"flight{self.companion_starts}.tlog")]
        # Two of four flights by the lidar say nothing of obstacles: what the autopilot tells is heard all the same.
        if self.cell != "lidar" or self.spec["seed"] // 2 % 2 == 0:
            command += ["--obstacles", str(self.dir / "posts.json") if self.sees_file() else "autopilot"]
        command += ["--via", self.spec["via"]]
        if self.lands():
            (self.dir / "landing.toml").write_text(f"FH_LND_MODE = {2 if self.pad else 1}\nFH_LND_REQ = 1\nFH_PAD_R = {PAD_M}\n")
            command += ["--params", str(self.dir / "landing.toml")]
        if self.pad:
            command += [f"--pad={self.pad[0]:.3f},{self.pad[1]:.3f}"]
        if self.cell == "signing":
            (self.dir / "key").write_text(KEY.hex() + "\n")
            command += ["--key", str(self.dir / "key")]
        self.start("companion", command, stdout=(self.dir / f"companion{self.companion_starts}.json").open("wb"))

    # -- links --

    def open_links(self):
        if self.kind == "ardupilot":
            self.listener = self.listener or listening()
            self.up, self.pilot = tcp(5760 + 10 * self.n), tcp(5762 + 10 * self.n)
            if self.down:  # the line to the companion ends with the autopilot
                self.down.close()
                self.down = None
        elif not self.up:
            self.up, self.pilot, self.down = (udp(port + self.n) for port in (14540, 18470, 15540))
            self.companion_at = ("127.0.0.1", 15640 + self.n)
        self.frames = {"pilot": Frames(), "up": Frames(), "down": Frames()}

    def send(self, message):
        data = message.pack(self.mav)
        self.mav.seq = (self.mav.seq + 1) % 256
        self.write(self.pilot, data, ("127.0.0.1", 18570 + self.n))

    def write(self, sock, data, address):
        try:
            if self.kind == "ardupilot":
                sock.sendall(data)
            else:
                sock.sendto(data, address)
        except OSError as error:
            self.say("cannot send:", error)

    def to_companion(self, data):
        if self.dropped or (self.kind == "ardupilot" and not self.down):
            return
        self.write(self.down, data, self.companion_at)

    def say(self, *words):
        print(f"[{time.monotonic() - self.began:7.2f}]", *words, file=self.log, flush=True)

    def pump(self, seconds=0.05):
        """Carries everything for so long."""
        end = time.monotonic() + seconds
        while True:
            now = time.monotonic()
            if now >= end:
                return
            if now - self.began > self.spec["time_max_s"]:
                raise Failed(f"takes longer than {self.spec['time_max_s']} s")
            self.periodic(now)
            sockets = {s: name for name in ("pilot", "up", "down", "listener") if (s := getattr(self, name))}
            for sock in select.select([*sockets, *self.caller], [], [], min(0.02, end - now))[0]:
                if sock in self.caller:  # the caller has ended
                    os.killpg(os.getpgrp(), signal.SIGKILL)
                self.receive(sock, sockets[sock])

    def periodic(self, now):
        if not self.pilot:
            return
        if now >= self.next_beat:
            self.next_beat = now + 1
            self.send(mavlink.MAVLink_heartbeat_message(mavlink.MAV_TYPE_GCS, mavlink.MAV_AUTOPILOT_INVALID, 0, 0, 4, 3))
        if now >= self.next_scan and self.truth and self.offset and not self.sees_file() and self.cell != "lidar":
            self.next_scan = now + 0.1
            scan = mavlink.MAVLink_obstacle_distance_message(0, 0, self.look(), 5, 20, int(100 * SCAN_RANGE_M), 5.0, 0.0, 12)
            self.sensor.srcSystem = self.beat.get_srcSystem()
            self.to_companion(scan.pack(self.sensor))
            self.sensor.seq = (self.sensor.seq + 1) % 256
        if self.cell == "wind" and self.kind == "px4" and self.offset and now >= self.next_wind:
            self.next_wind = now + 1
            speed = self.random.uniform(5.0, 11.0)
            self.set_parameter("SIH_WIND_N", -0.94 * speed)
            self.set_parameter("SIH_WIND_E", -0.34 * speed)

    def receive(self, sock, name):
        if name == "listener":
            if self.down:
                self.down.close()
            self.down = sock.accept()[0]
            self.down.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            self.frames["down"] = Frames()
            return
        try:
            data = sock.recv(65536)
        except OSError:
            return
        if not data:
            self.say("the peer closed", name)
            sock.close()
            setattr(self, name, None)
            return
        now = time.monotonic()
        if name == "up":
            self.to_companion(data)
        elif name == "down" and not self.dropped:
            if self.up:
                self.write(self.up, data, ("127.0.0.1", 14580 + self.n))
        for message in self.frames[name].of(data):
            if name == "pilot":
                self.hear_autopilot(message)
            elif name == "up":
                self.tap_autopilot(message, now)
            elif not self.dropped:
                self.tap_companion(message, now)

    # -- what is heard --

    def hear_autopilot(self, m):
        kind = m.get_type()
        if kind == "STATUSTEXT":
            self.say("told by", m.get_srcComponent(), m.text)
        if m.get_srcComponent() != 1:
            return
        if kind == "HEARTBEAT":
            if not self.beat or (self.beat.custom_mode, self.beat.base_mode) != (m.custom_mode, m.base_mode):
                self.say(f"mode {m.custom_mode:#x} {'armed' if m.base_mode & ARMED else 'disarmed'}")
            self.beat = m
        elif kind == "SYS_STATUS":
            self.ready = bool(m.onboard_control_sensors_health & mavlink.MAV_SYS_STATUS_PREARM_CHECK)
        elif kind == "PARAM_VALUE":
            self.parameters[m.param_id] = m.param_value
        elif kind == "EXTENDED_SYS_STATE":
            self.landed = m.landed_state
        elif kind == "COMMAND_ACK":
            self.acks[m.command] = m.result
        elif kind == "STATUSTEXT":
            self.texts.append(m.text)
        elif kind == "LOCAL_POSITION_NED":
            self.estimate = m
        elif kind == "SIM_STATE":
            self.see(m.lat_int, m.lon_int, m.alt - ALTITUDE, math.hypot(m.vn, m.ve), m.yaw)
        elif kind == "HIL_STATE_QUATERNION":
            w, x, y, z = m.attitude_quaternion
            yaw = math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))
            self.see(m.lat, m.lon, m.alt * 1e-3 - ALTITUDE, math.hypot(m.vx, m.vy) * 1e-2, yaw)

    def see(self, lat, lon, height, speed, yaw):
        """Where the vehicle is in truth, from its home: north, east, height, speed, yaw."""
        north = math.radians(lat * 1e-7 - self.home[0]) * METRES_PER_RAD
        east = math.radians(lon * 1e-7 - self.home[1]) * METRES_PER_RAD * math.cos(math.radians(self.home[0]))
        self.truth = (north, east, height, speed, yaw)
        if not self.offset or not self.estimate:
            return
        seen = (self.estimate.x, self.estimate.y)
        true = self.true_place()
        e = self.estimate
        row = (time.monotonic() - self.began, *true, height, speed, yaw, e.x, e.y, -e.z, e.vx, e.vy)
        print(*(f"{value:.3f}" for value in row), sep=",", file=self.track)
        off = math.dist(seen, true)
        self.off_m = max(self.off_m or 0.0, off)
        if height > 1.5 and self.is_in_control() and not self.has_ended():
            clearance = lambda place: min(math.dist(place, post[:2]) - post[2] for post in self.posts) - HULL_M
            if clearance(true) < (self.clearance_m or 99.0):
                self.clearance_m, self.least_at = clearance(true), time.monotonic() - (self.in_control_since or time.monotonic())
            self.seen_clearance_m = min(self.seen_clearance_m or 99.0, clearance(seen))

    def true_place(self):
        """In the frame in which posts and beacon were laid: the autopilot's, when the flight was given to the companion."""
        return tuple(place - off for place, off in zip(self.truth, self.offset))

    def look(self):
        """Distances in 72 directions from the nose, to the nearest post in each; cm."""
        (north, east), yaw = self.true_place(), self.truth[4]
        near = [(n - north, e - east, r) for n, e, r in self.posts if math.hypot(n - north, e - east) < SCAN_RANGE_M + r]
        distances = []
        for sector in range(72):
            nearest = SCAN_RANGE_M + 0.01
            for part in (-2.0, -1.0, 0.0, 1.0, 2.0):
                angle = yaw + math.radians(5 * sector + part)
                ahead, right = math.cos(angle), math.sin(angle)
                for n, e, r in near:
                    along, aside = n * ahead + e * right, e * ahead - n * right
                    if along > 0 and abs(aside) < r:
                        nearest = min(nearest, along - math.sqrt(r * r - aside * aside))
            distances.append(max(20, round(100 * nearest)))
        return distances

    # -- the tap --

    def is_in_control(self):
        return bool(self.beat) and self.beat.custom_mode == self.modes["give"] and bool(self.beat.base_mode & ARMED)

    def tap_autopilot(self, m, now):
        if m.get_type() == "EXTENDED_SYS_STATE" and m.get_srcComponent() == 1:
            self.landed = m.landed_state  # as on the pilot's link, whichever tells it first
        if m.get_type() == "HEARTBEAT" and m.get_srcComponent() == 1:
            has = m.custom_mode == self.modes["give"] and bool(m.base_mode & ARMED)
            if has != (self.in_control_since is not None):
                self.in_control_since = now if has else None
                self.mode_at = now
                self.setpoint_at = None

    def tap_companion(self, m, now):
        kind = m.get_type()
        signed = bool(m._header.incompat_flags & 1)
        self.count["unsigned"] += not signed
        if kind == "STATUSTEXT":
            self.told.append(m.text)
            self.say("companion:", m.text)
        if kind != "SET_POSITION_TARGET_LOCAL_NED":
            return
        self.count["setpoints"] += 1
        self.setpoint = (m.vx, m.vy, m.vz, m.yaw_rate)
        moves = any(abs(value) > 1e-4 for value in self.setpoint)
        in_control = self.in_control_since is not None
        rising = self.landed == mavlink.MAV_LANDED_STATE_TAKEOFF and self.kind == "ardupilot"
        if (not in_control and now - self.mode_at > MODE_KNOWN_S or rising) and (moves or self.kind == "ardupilot"):
            self.count["stray"] += 1
            self.say("stray setpoint", self.setpoint)
        if not all(map(math.isfinite, self.setpoint)) or (
            math.hypot(m.vx, m.vy) > SPEED_MAX_MPS + 1e-3 or abs(m.vz) > CLIMB_MAX_MPS + 1e-3 or abs(m.yaw_rate) > TURN_MAX_RADPS + 1e-3
        ):
            self.count["over"] += 1
            self.say("setpoint over the limits", self.setpoint)
        if in_control and self.setpoint_at:
            gap = now - self.setpoint_at
            if gap > 0.2:
                self.say(f"gap of {gap:.2f} s")
            self.longest_gap_s = max(self.longest_gap_s or 0.0, gap)
        self.setpoint_at = now if in_control else None
        if moves and in_control:
            self.moved_at = self.moved_at or now

    # -- the result --

    def result(self, wrong):
        self.pump(0.2)
        companion = self.processes.get("companion")
        if companion and companion.poll() is None:
            companion.terminate()
            end = time.monotonic() + 8
            while companion.poll() is None and time.monotonic() < end:
                self.pump(0.1)
        text = (self.dir / f"companion{self.companion_starts}.json").read_text() if self.companion_starts else ""
        report = json.loads(text.splitlines()[-1]) if text.strip() else {}
        to_beacon = math.dist(self.true_place(), self.pad or self.beacon) if self.truth and self.offset else None
        if not wrong and self.cell not in ("battery", "fence"):
            wrong = None if report.get("result") == "reached" else f"the companion ended {report.get('result')}, {report.get('reason')}"
        if self.pad and to_beacon is not None and to_beacon > 2 * PAD_M and not wrong:
            wrong = f"landed {to_beacon:.2f} m from the middle of the pad"
        for name, is_allowed in (("stray", False), ("over", False), ("unsigned", self.cell != "signing")):
            if self.count[name] and not is_allowed and not wrong:
                wrong = f"{self.count[name]} {name} setpoints or frames"
        least = self.seen_clearance_m if self.sees_file() else self.clearance_m
        if least is not None and least <= 0 and not wrong:
            wrong = f"touched a post: {least:.2f} m, {self.least_at:.1f} s after control was given"
        numbers = {"clearance_m": self.clearance_m, "seen_clearance_m": self.seen_clearance_m, "off_m": self.off_m}
        numbers |= {"longest_gap_s": self.longest_gap_s, "to_beacon_m": to_beacon}
        seconds = time.monotonic() - self.began
        return {"wrong": wrong, "companion": report.get("result"), "seconds": seconds, "told": self.told, **numbers, **self.count}


def signing_time():
    return int((time.time() - EPOCH_S) * 1e5)


def px4_values(path):
    """Name and value of every line of a parameter file of QGroundControl: vehicle, component, name, value, type."""
    for line in pathlib.Path(path).read_text().splitlines():
        if line.strip() and not line.startswith("#"):
            _, _, name, value, _ = line.split("\t")
            yield name, value


def tcp(port):
    end = time.monotonic() + 40
    while True:
        try:
            sock = socket.create_connection(("127.0.0.1", port), timeout=2)
            sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            return sock
        except OSError:
            if time.monotonic() > end:
                raise Failed(f"nothing listens on port {port}") from None
            time.sleep(0.2)


def udp(port):
    sock = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    sock.bind(("127.0.0.1", port))
    return sock


def listening():
    sock = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
    sock.bind(("127.0.0.1", 0))
    sock.listen(1)
    return sock
