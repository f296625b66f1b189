"""MAVSDK in the place of an autopilot: it reads what a companion says, and tells it in JSON, a line each message.

The first line is `{"port": N}`, where it can be reached by UDP. It says what an autopilot in the companion's mode would
say, and goes where it is told to. MAVSDK is there twice, on raw connections: as the autopilot itself, and as a ground
station, which sets and lists the companion's parameters. It ends when its standard input does, or when it was left alone.

Usage: mavsdk_autopilot.py ardupilot|px4
"""

import json
import math
import os
import queue
import socket
import sys
import threading
import time

from mavsdk import ComponentType, Configuration, Mavsdk
from mavsdk.plugins.mavlink_direct import MavlinkDirect, MavlinkMessage
from mavsdk.plugins.param import Param, ParamError, ParamResult, ProtocolVersion

HEARTBEAT = 0
COMPANION = 191
SET_MESSAGE_INTERVAL = 511
QUADROTOR, ARMED = 2, 0x81
# Its number, a mode in which it obeys no companion (LOITER, Hold), and the one in which it does (GUIDED, OFFBOARD).
SOFTWARE, HOLD, CONTROL = {"ardupilot": (3, 5, 4), "px4": (12, 4 << 16 | 3 << 24, 6 << 16)}[sys.argv[1]]
STEP_S = 0.02
LEFT_ALONE_S = 10.0
ASKED_MOST = 10

out_lock = threading.Lock()


def tell(**line):
    with out_lock:
        print(json.dumps(line), flush=True)


class Wire:
    """The socket. One companion, whoever spoke last."""

    def __init__(self):
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.bind(("127.0.0.1", 0))
        self.socket.settimeout(0.2)
        self.companion = None

    def send(self, data):
        # MAVSDK's own heartbeat says that it is no autopilot in particular: ours says which, and the mode.
        is_own_heartbeat = data[7:10] == b"\0\0\0" and data[5:7] == b"\x01\x01" and data[15] == 0
        if self.companion and not is_own_heartbeat:
            self.socket.sendto(data, self.companion)


class Vehicle:
    def __init__(self):
        self.position, self.velocity = [0.0, 0.0, -5.0], [0.0, 0.0, 0.0]
        self.yaw, self.yaw_rate = 0.0, 0.0
        self.is_given = False

    def step(self):
        if not self.is_given:
            return
        self.position = [x + v * STEP_S for x, v in zip(self.position, self.velocity)]
        self.yaw = math.remainder(self.yaw + self.yaw_rate * STEP_S, 2 * math.pi)


def find_system(mavsdk):
    while not (systems := mavsdk.get_systems()):
        time.sleep(0.02)
    return systems[0]


wire, vehicle, is_over = Wire(), Vehicle(), threading.Event()
orders = queue.Queue()
autopilot = Mavsdk(Configuration.create_manual(1, 1, True))
station = Mavsdk(Configuration.create_with_component_type(ComponentType.GROUND_STATION))
for peer in (autopilot, station):
    peer.add_any_connection("raw://")
    peer.subscribe_raw_bytes_to_be_sent(wire.send)


def receive():
    heard_at = math.inf
    while not is_over.is_set():
        try:
            data, wire.companion = wire.socket.recvfrom(4096)
        except TimeoutError:
            if time.monotonic() > heard_at + LEFT_ALONE_S:
                is_over.set()
            continue
        heard_at = time.monotonic()
        autopilot.pass_received_raw_bytes(data)
        station.pass_received_raw_bytes(data)


def heard(message, _):
    fields = json.loads(message.fields_json)
    tell(name=message.message_name, sender=[message.system_id, message.component_id], fields=fields)
    if message.message_name == "SET_POSITION_TARGET_LOCAL_NED":
        vehicle.velocity = [fields["vx"], fields["vy"], fields["vz"]]
        vehicle.yaw_rate = fields["yaw_rate"]
    elif message.message_name == "COMMAND_LONG" and fields["command"] == SET_MESSAGE_INTERVAL:
        orders.put(message)


def speak(direct):
    """Telemetry, as MAVSDK encodes it."""

    def send(name, **fields):
        direct.send_message(MavlinkMessage(name, 1, 1, 0, 0, json.dumps(fields)))

    begin, step = time.monotonic(), 0
    while not is_over.is_set():
        while not orders.empty():
            orders.get()
            result = {"result": 0, "progress": 0, "result_param2": 0}
            send("COMMAND_ACK", command=SET_MESSAGE_INTERVAL, target_system=1, target_component=COMPANION, **result)
        if step % 50 == 0:
            mode = {"base_mode": ARMED, "custom_mode": CONTROL if vehicle.is_given else HOLD}
            send("HEARTBEAT", type=QUADROTOR, autopilot=SOFTWARE, system_status=4, mavlink_version=3, **mode)
        boot = {"time_boot_ms": int(step * STEP_S * 1000)}
        (x, y, z), (vx, vy, vz) = vehicle.position, vehicle.velocity
        send("LOCAL_POSITION_NED", x=x, y=y, z=z, vx=vx, vy=vy, vz=vz, **boot)
        turn = {"roll": 0.0, "pitch": 0.0, "yaw": vehicle.yaw, "rollspeed": 0.0, "pitchspeed": 0.0}
        send("ATTITUDE", yawspeed=vehicle.yaw_rate, **turn, **boot)
        vehicle.step()
        step += 1
        time.sleep(max(0.0, begin + step * STEP_S - time.monotonic()))


def insist(ask, is_told=lambda answer: True):
    """On a busy machine an answer may come too late: it is asked for again."""
    for _ in range(ASKED_MOST - 1):
        try:
            if is_told(answer := ask()):
                return answer
        except ParamError as error:
            if error.result != ParamResult.TIMEOUT:
                raise
    return ask()


def set_parameters():
    """As a ground station: switches two outputs on, lists everything, gives control, and tries to change the speed then."""
    params = Param(find_system(station))
    try:
        params.select_component(COMPANION, ProtocolVersion.V1)
    except ParamError as error:
        # It selects, and says that it does not know whether it did.
        if error.result != ParamResult.UNKNOWN:
            raise
    for name in ("FH_LND_OUT", "FH_OBS_OUT"):
        insist(lambda: params.set_param_float(name, 1.0))
    # A list that did not come is empty.
    listed = insist(params.get_all_params, lambda listed: listed.float_params)
    tell(params={p.name: p.value for p in listed.float_params}, others=len(listed.int_params + listed.custom_params))
    vehicle.is_given = True
    while math.hypot(*vehicle.velocity) < 0.5:
        time.sleep(0.05)
    try:
        params.set_param_float("FH_SPD_MAX", 0.5)
        tell(changed_in_flight=True)
    except ParamError:
        tell(changed_in_flight=False)


threads = [threading.Thread(target=receive, daemon=True)]
threads[0].start()
tell(port=wire.socket.getsockname()[1])


def run():
    direct = MavlinkDirect(find_system(autopilot))
    direct.subscribe_message("", heard)
    threads.append(threading.Thread(target=speak, args=(direct,), daemon=True))
    threads[-1].start()
    set_parameters()


threading.Thread(target=run, daemon=True).start()
threading.Thread(target=lambda: (os.read(0, 1), is_over.set()), daemon=True).start()
is_over.wait()
for thread in threads:
    thread.join()
autopilot.destroy()
station.destroy()
