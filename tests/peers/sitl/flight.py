"""One flight of `foxhound companion` beside a real autopilot in its own simulator.

    flight.py FLIGHT.json      as `cargo xtask sitl` writes it; the last line of the output is the result, one JSON object

Starts ArduCopter SITL or PX4 SITL (its built-in quadrotor, SIH) and the companion, plays the pilot on a second link, makes the
cell's fault, and measures what nobody tells it about himself:

- a tap between companion and autopilot receives every setpoint and knows the mode: gaps, setpoints outside of the mode, limits;
- the simulator's own position (SIM_STATE, HIL_STATE_QUATERNION) gives clearance, distance to the beacon and touch-down error;
- what an obstacle sensor on the vehicle would see of the posts is computed from that position and put in by the tap, as
  OBSTACLE_DISTANCE of another component.

Every process that it starts is in its own process group, which the caller ends.
"""

import json
import math
import pathlib
import struct
import sys
import time

from bench import ARMED, HEIGHT_M, KEY, METRES_PER_RAD, Bench, Failed, Skipped, mavlink, signing_time

# Texts of the companion after which it waits for the mode to be entered again.
ENTER_AGAIN = ("velocity contradicts position", "position stands still")


class Flight(Bench):
    """The pilot, and what goes wrong."""

    # -- the pilot --

    def wait(self, what, true, seconds):
        end = time.monotonic() + seconds
        while not true():
            if time.monotonic() > end:
                raise Failed(f"no {what} within {seconds:g} s; the autopilot said last: {self.texts[-3:]}")
            if self.processes["autopilot"].poll() is not None:
                raise Failed(f"the autopilot ended with {self.processes['autopilot'].returncode}")
            self.pump()
        self.say(what)

    def command(self, number, *params):
        params = (list(params) + [0.0] * 7)[:7]
        for _ in range(4):
            self.acks.pop(number, None)
            self.send(mavlink.MAVLink_command_long_message(self.beat.get_srcSystem(), 1, number, 0, *params))
            end = time.monotonic() + 1.5
            while number not in self.acks and time.monotonic() < end:
                self.pump(0.02)
            if self.acks.get(number) not in (None, mavlink.MAV_RESULT_IN_PROGRESS):
                break
        return self.acks.get(number)

    def set_parameter(self, name, value):
        kind = mavlink.MAV_PARAM_TYPE_REAL32
        if self.kind == "px4" and isinstance(value, int):  # the bits of the integer
            kind, value = mavlink.MAV_PARAM_TYPE_INT32, struct.unpack("<f", struct.pack("<i", value))[0]
        self.send(mavlink.MAVLink_param_set_message(self.beat.get_srcSystem(), 1, name.encode(), value, kind))

    def set_parameters(self, **values):
        """Those of a fault: an autopilot without one of them cannot fly the cell."""
        for name, value in values.items():
            for _ in range(3):
                self.parameters.pop(name, None)
                self.set_parameter(name, value)
                end = time.monotonic() + 1.0
                while name not in self.parameters and time.monotonic() < end:
                    self.pump(0.02)
                if name in self.parameters:
                    break
            else:
                raise Skipped(f"no parameter {name}")

    def set_mode(self, name, seconds=20):
        want, end = self.modes[name], time.monotonic() + seconds
        main, sub = (want, 0) if self.kind == "ardupilot" else (want >> 16 & 0xFF, want >> 24)
        while self.beat.custom_mode != want:
            if name == "give" and "companion" in self.processes and self.has_ended():
                return
            if time.monotonic() > end:
                raise Failed(f"mode {name} was not taken; the autopilot said last: {self.texts[-3:]}")
            self.command(mavlink.MAV_CMD_DO_SET_MODE, mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED, main, sub)
            self.pump(0.5)

    def take_off(self):
        self.wait("heartbeat", lambda: self.beat, 60)
        if self.cell == "signing":
            self.sign()
        truth = 108 if self.kind == "ardupilot" else 115
        for message, hz in ((32, 25), (1, 2), (245, 4), (truth, 25)):
            self.command(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, message, 1e6 / hz)
        self.wait("pre-arm checks passed", lambda: self.ready and self.estimate and self.truth, 120)
        if self.kind == "ardupilot":
            self.set_mode("give")
        else:
            self.set_parameter("MIS_TAKEOFF_ALT", HEIGHT_M)
            self.pump(0.5)
        end = time.monotonic() + 60
        while self.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1) != mavlink.MAV_RESULT_ACCEPTED:
            if time.monotonic() > end:
                raise Failed(f"it would not arm: {self.texts[-3:]}")
            self.pump(2)
        ground = self.truth[2]
        nan = math.nan
        height = (0, 0, 0, 0, 0, 0, HEIGHT_M) if self.kind == "ardupilot" else (nan, 0, 0, nan, nan, nan, nan)
        self.command(mavlink.MAV_CMD_NAV_TAKEOFF, *height)
        self.lay_offset()
        self.wait(f"{HEIGHT_M} m", lambda: self.truth[2] - ground > HEIGHT_M - 0.6, 60)
        if self.kind == "px4":
            self.wait("hold", lambda: self.beat.custom_mode == self.modes["hold"], 20)
        self.has_taken_off = True

    def lay_offset(self):
        if not self.offset:
            self.offset = (self.truth[0] - self.estimate.x, self.truth[1] - self.estimate.y)

    def sign(self):
        if self.kind == "ardupilot":
            setup = mavlink.MAVLink_setup_signing_message(self.beat.get_srcSystem(), 1, KEY, signing_time())
            for _ in range(2):
                self.send(setup)
                self.pump(0.5)
        self.mav.signing.secret_key, self.mav.signing.sign_outgoing = KEY, True
        self.mav.signing.timestamp = signing_time()
        self.count["unsigned"] = 0

    def give(self):
        self.set_mode("give")  # ends early where the companion has ended
        self.say("given")

    def under_way(self):
        """Has gone 3 m towards the beacon under the companion's setpoints."""
        return self.moved_at and math.dist(self.true_place(), self.beacon) < math.hypot(*self.beacon) - 3.0

    def stands(self, seconds=5.0):
        """Within 6 s nothing but zero comes, or nothing, and the vehicle stands for so long."""
        since, end = None, time.monotonic() + 6.0 + seconds
        while time.monotonic() < end:
            self.pump()
            moves = self.setpoint and any(abs(value) > 1e-4 for value in self.setpoint) and self.setpoint_at
            still = not moves and self.truth[3] < 0.5
            since = (since or time.monotonic()) if still else None
            if since and time.monotonic() - since > seconds:
                return True
        return False

    # -- cells --

    def fly(self):
        """The whole flight; returns what is wrong with it, or nothing."""
        if self.cell == "lidar" and self.kind == "px4":
            raise Skipped("its simulator has no such sensor")
        self.start_autopilot()
        if self.cell == "signing":  # the companion believes nothing before the key is there
            self.wait("heartbeat", lambda: self.beat, 60)
            self.sign()
        self.start_companion()
        self.take_off()
        if self.kind == "px4":
            self.pump(2.0)
            self.give()
        if self.cell == "wind" and self.kind == "ardupilot":
            self.set_parameters(SIM_WIND_T=1, SIM_WIND_DIR=20, SIM_WIND_TURB=2, SIM_WIND_SPD=8)
        wrong = getattr(self, f"fault_{self.cell}", lambda: None)()
        if self.cell in ("battery", "fence") or wrong:
            return wrong
        end = time.monotonic() + 120
        while not self.has_ended():
            if time.monotonic() > end:
                return "the beacon was not reached in 120 s"
            self.tend()
            self.pump()
        if self.lands():
            self.wait("disarmed", lambda: not self.beat.base_mode & ARMED, 60)
        self.pump(1.0)
        return None

    def tend(self):
        """As the manual tells the pilot: gives back what a failsafe took, and enters the mode again where that is asked."""
        if not self.lands() and self.in_control_since is None and time.monotonic() - self.mode_at > 4.0:
            self.count["given_back"] += 1
            self.give()
        if self.told and any(words in self.told[-1] for words in ENTER_AGAIN):
            self.told.append("")
            self.enter_again()

    def enter_again(self):
        self.say("enters the mode again")
        self.count["reentries"] += 1
        self.set_mode("hold")
        self.pump(1.0)
        self.give()

    def way(self):
        def under_way():
            self.tend()
            return self.under_way()

        self.wait("under way", under_way, 90)

    def fault_gps_glitch(self):
        self.way()
        if self.kind == "ardupilot":
            self.set_parameters(SIM_GPS1_GLTCH_X=5e-5)  # 5.6 m to the north
            self.pump(4.0)
            self.set_parameters(SIM_GPS1_GLTCH_X=0.0)
        else:
            self.set_parameters(SIM_GPS_USED=0)
            self.pump(4.0)
            self.set_parameters(SIM_GPS_USED=10)

    def fault_ekf_reset(self):
        self.way()
        before = (self.estimate.x - self.truth[0], self.estimate.y - self.truth[1])
        if self.kind == "ardupilot":
            self.set_parameters(SIM_GPS1_GLTCH_X=5e-5)
        else:
            lat = self.home[0] + math.degrees((self.truth[0] + 3.0) / METRES_PER_RAD)
            lon = self.home[1] + math.degrees(self.truth[1] / METRES_PER_RAD / math.cos(math.radians(self.home[0])))
            place = mavlink.MAVLink_command_int_message(
                self.beat.get_srcSystem(), 1, 0, 43003, 0, 0, 0, 0.0, 0.1, 0, int(lat * 1e7), int(lon * 1e7), math.nan
            )
            self.send(place)
        jumped = lambda: math.dist(before, (self.estimate.x - self.truth[0], self.estimate.y - self.truth[1])) > 1.5
        end = time.monotonic() + 30
        while not jumped() and not self.has_ended():
            if time.monotonic() > end:
                break
            self.pump(0.02)
        if not jumped():
            return "the estimator did not reset its position"
        self.say("the estimate has jumped")
        return None

    def fault_mode_stolen(self):
        self.way()
        self.set_mode("hold")
        self.pump(5.0)
        self.give()

    def fault_link_dropped(self):
        self.way()
        self.dropped = True
        self.say("link down")
        self.pump(3.0)
        self.dropped = False
        self.say("link up")

    def fault_autopilot_restarted(self):
        self.way()
        self.kill("autopilot")
        self.in_control_since, self.setpoint_at, self.moved_at = None, None, None
        self.mode_at = time.monotonic() + 1.5  # the companion cannot know it for FH_HB_TMO, 2.5 s
        for name in ("up", "pilot"):
            if self.kind == "ardupilot" and getattr(self, name):
                getattr(self, name).close()
                setattr(self, name, None)
        self.pump(1.0)
        self.landed = None
        self.start_autopilot()
        self.take_off()
        self.pump(2.0)
        self.set_mode("hold")
        self.give()

    def fault_companion_restarted(self):
        self.way()
        self.kill("companion")
        self.pump(2.0)
        if self.kind == "px4":  # leaves the mode by itself, which its next heartbeat tells, and enters it when setpoints come again
            self.wait("left the mode", lambda: not self.is_in_control(), 5)
        self.moved_at = self.setpoint_at = None
        told = len(self.told)
        self.start_companion()
        self.wait("a fresh entry asked for", lambda: any("enter it again" in text for text in self.told[told:]), 30)
        if not self.stands():
            return "it flew on in the mode that it was started in"
        self.enter_again()
        return None

    def fault_battery(self):
        self.way()
        if self.kind == "ardupilot":
            self.set_parameters(BATT_FS_CRT_ACT=0, BATT_FS_LOW_ACT=0, BATT_CRT_VOLT=10.5, BATT_LOW_TIMER=1, SIM_BATT_VOLTAGE=10.0)
        else:
            self.set_parameters(COM_LOW_BAT_ACT=0, SIM_BAT_MIN_PCT=0.0, SIM_BAT_DRAIN=1.0)
        return self.holds("battery")

    def fault_fence(self):
        self.way()
        if self.kind == "ardupilot":
            self.set_parameters(AVOID_ENABLE=0, FENCE_TYPE=2, FENCE_ACTION=0, FENCE_RADIUS=5)
        else:
            self.set_parameters(GF_ACTION=2, GF_MAX_HOR_DIST=5.0)
        return self.holds("fence")

    def holds(self, word):
        end = time.monotonic() + 40
        heard = lambda: any(word in text.lower() for text in self.told) or not self.is_in_control()
        while not heard():
            if self.has_ended() or time.monotonic() > end:
                return f"the companion said nothing of the {word}"
            self.pump()
        return None if self.stands() else "it did not stand"


def main():
    flight = Flight(json.loads(pathlib.Path(sys.argv[1]).read_text()))
    try:
        wrong = flight.fly()
    except Failed as failed:
        wrong = str(failed)
    except Skipped as skipped:
        flight.say("skipped:", skipped)
        print(json.dumps({"skipped": str(skipped)}))
        return
    flight.say("wrong:", wrong)
    try:
        result = flight.result(wrong)
    except Failed as failed:
        result = {"wrong": wrong or str(failed)}
    print(json.dumps(result | {"took_off": flight.has_taken_off}))


if __name__ == "__main__":
    main()
