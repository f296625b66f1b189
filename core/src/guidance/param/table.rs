//! The table of parameters.

use super::{Kind, Param};

const fn real(name: &'static str, unit: &'static str, default: f32, [min, max]: [f32; 2], doc: &'static str) -> Param {
    Param { name, unit, default, min, max, kind: Kind::Real, doc }
}

const fn whole(name: &'static str, default: f32, [min, max]: [f32; 2], doc: &'static str) -> Param {
    Param { name, unit: "", default, min, max, kind: Kind::Whole, doc }
}

const fn switch(name: &'static str, default: f32, doc: &'static str) -> Param {
    whole(name, default, [0.0, 1.0], doc)
}

/// All parameters, in the order of the list.
pub const TABLE: &[Param] = &[
    // Motion.
    real("FH_SPD_MAX", "m/s", 1.0, [0.05, 20.0], "Largest horizontal speed."),
    real(
        "FH_SPD_EVADE",
        "m/s",
        0.0,
        [0.0, 20.0],
        "Largest horizontal speed while giving way to what moves, where that is above FH_SPD_MAX.",
    ),
    real("FH_SPD_Z_MAX", "m/s", 0.5, [0.0, 5.0], "Largest vertical speed."),
    real("FH_ACC_MAX", "m/s/s", 2.0, [0.1, 20.0], "Largest change of the commanded velocity."),
    real("FH_JERK_MAX", "m/s/s/s", 20.0, [1.0, 1000.0], "Largest change of the acceleration while the speed grows."),
    real("FH_YAWR_MAX", "rad/s", 2.5, [0.1, 6.3], "Largest yaw rate."),
    real("FH_DEAD_TIME", "s", 0.32, [0.0, 1.12], "Time from a setpoint to the vehicle's first motion."),
    real("FH_LAG", "s", 0.5, [0.0, 5.0], "Time constant of the vehicle's velocity after that."),
    // Distances to keep.
    real("FH_RADIUS", "m", 0.15, [0.0, 5.0], "Radius of the vehicle with its propellers."),
    real("FH_MARGIN", "m", 0.05, [0.0, 5.0], "Clearance that a plan keeps from every known obstacle."),
    real("FH_MARGIN_TGT", "m", 0.02, [0.0, 5.0], "Clearance that a plan keeps in narrow gaps; at most FH_MARGIN."),
    real(
        "FH_MARGIN_GRD",
        "m",
        0.03,
        [0.0, 5.0],
        "Clearance that the guard keeps from every obstacle, whatever the plan.",
    ),
    real("FH_APPR_RATE", "1/s", 2.0, [0.1, 20.0], "Share of the remaining clearance that may be used up per second."),
    real(
        "FH_ALT_BAND",
        "m",
        2.0,
        [0.1, 1000.0],
        "Largest deviation from the altitude at which control was given, up or down.",
    ),
    real(
        "FH_FENCE_R",
        "m",
        0.0,
        [0.0, 10_000.0],
        "Farthest from the origin of the autopilot's local frame, horizontally, 1 m at least; 0: anywhere.",
    ),
    real("FH_FENCE_MRG", "m", 0.5, [0.0, 100.0], "Distance that is kept from the fence, on its inside."),
    // Obstacle sensor.
    real("FH_OBS_FOV", "deg", 90.0, [5.73, 360.0], "Full angle of the obstacle sensor's view, centred on the nose."),
    real("FH_OBS_RANGE", "m", 3.0, [0.1, 100.0], "How far the obstacle sensor sees."),
    real("FH_OBS_MIN", "m", 0.075, [0.05, 1.0], "Radius of the smallest obstacle that must not be overlooked."),
    real(
        "FH_OBS_SIDE",
        "",
        0.5,
        [0.0, 1.0],
        "Share of the speed that is allowed outside the sensor's view, into places that it has seen.",
    ),
    real(
        "FH_START_CLR",
        "m",
        0.03,
        [0.0, 1.0],
        "Distance from the vehicle within which nothing unseen is assumed at the start.",
    ),
    whole(
        "FH_OBS_SRC",
        0.0,
        [0.0, 2.0],
        "Source of obstacles: 0 MAVLink messages, 1 only the lidar on the computer's own serial line, 2 the same with the lidar mounted upside down.",
    ),
    real("FH_LDR_YAW", "deg", 0.0, [-180.0, 180.0], "Direction of that lidar's arrow, from the nose, clockwise."),
    // Planning and search.
    real("FH_TGT_DIST", "m", 2.0, [0.5, 20.0], "Distance of the temporary target along the bearing."),
    real("FH_RPL_TIME", "s", 0.7, [0.1, 60.0], "A new plan is requested after this long at the latest."),
    whole("FH_RPL_WPT", 5.0, [1.0, 15.0], "A new plan is requested when this many of its 15 waypoints are passed."),
    switch("FH_BENDS", 1.0, "1: bends the path to measure the beacon's range where no obstacle is near."),
    switch("FH_REFLECT", 1.0, "1: recognises reflections and traces them back to the beacon."),
    real(
        "FH_SRCH_TIME",
        "s",
        0.0,
        [0.0, 3600.0],
        "How long it searches while there is no signal, 1 s at least; 0: it holds instead.",
    ),
    real(
        "FH_SRCH_R",
        "m",
        15.0,
        [1.0, 200.0],
        "Largest distance from the start of a search; beyond 15 m the map of the search gets coarser.",
    ),
    // Time limits.
    real("FH_POS_AGE", "s", 0.3, [0.02, 5.0], "It holds when the position is older than this."),
    real("FH_ATT_AGE", "s", 0.2, [0.02, 5.0], "It holds when the attitude is older than this."),
    real("FH_OBS_AGE", "s", 0.5, [0.05, 10.0], "It holds when no obstacle sensor has reported for this long."),
    switch("FH_OBS_REQ", 1.0, "1: requires an obstacle sensor. 0: flies without one, blind."),
    real(
        "FH_BRG_AGE",
        "s",
        1.0,
        [0.05, 60.0],
        "It holds, or searches, when there was no usable bearing for this long.",
    ),
    real("FH_NOPATH_T", "s", 15.0, [0.5, 600.0], "It gives up after this long without a path."),
    real("FH_STALL_T", "s", 20.0, [1.0, 600.0], "It gives up after this long without progress."),
    real("FH_STALL_R", "m", 1.0, [0.1, 100.0], "Progress means having moved this far since the time started."),
    // Antennas.
    real("FH_WAVELEN", "m", 0.345, [0.001, 10.0], "Wavelength of the beacon's carrier."),
    real(
        "FH_ARR_SIDE",
        "m",
        0.4 * 0.345,
        [0.001, 4.9],
        "Side of the square of antennas; less than half of FH_WAVELEN.",
    ),
    switch("FH_CAL_REQ", 0.0, "1: no bearing is valid without a calibration of the antennas."),
    real("FH_CH_SIGMA", "rad", 0.0, [0.0, 1.0], "Phase error left in each channel after calibration, rms."),
    real("FH_SMP_RATE", "Hz", 102_400.0, [1e3, 1e7], "Sample rate of each channel."),
    real(
        "FH_TONE",
        "Hz",
        0.0,
        [0.0, 4.9e6],
        "Frequency of the tone if it is known; 0: it is searched for in the band.",
    ),
    real("FH_TONE_LO", "Hz", 2_000.0, [0.0, 4.8e6], "Lower end of the tone's band."),
    real("FH_TONE_HI", "Hz", 49_000.0, [12.0, 5e6], "Upper end of the tone's band; at most half of FH_SMP_RATE."),
    whole(
        "FH_TURN",
        0.0,
        [0.0, 2.0],
        "Finding the beacon by turning the vehicle: 0 never, 1 while fewer than three channels work, 2 always, with one antenna.",
    ),
    real(
        "FH_TURN_RATE",
        "rad/s",
        1.2,
        [-6.3, 6.3],
        "Turn rate for that; negative to the left; 0.4 at least, at most FH_YAWR_MAX.",
    ),
    whole("FH_TURN_CH", 0.0, [0.0, 3.0], "Channel of the one antenna, 0 to 3."),
    // Arrival.
    whole(
        "FH_LND_MODE",
        0.0,
        [0.0, 2.0],
        "On arrival: 0 goes on seeking, 1 hovers above the beacon and hands over, 2 lands on the pad that its camera sees.",
    ),
    switch(
        "FH_LND_REQ",
        0.0,
        "1: asks the autopilot to land where it has arrived without a camera, and to disarm on the pad. 0: never.",
    ),
    real("FH_PAD_R", "m", 0.25, [0.02, 5.0], "Radius of the pad: a plain red disc."),
    real(
        "FH_CAM_FOCAL",
        "",
        0.866,
        [0.2, 5.0],
        "Focal length of the camera divided by the width of its picture; 0.866 is 60 degrees from left to right.",
    ),
    // Link.
    real("FH_SP_AGE", "s", 0.25, [0.05, 1.0], "A setpoint older than this is replaced by zero velocity."),
    real(
        "FH_HB_TMO",
        "s",
        2.5,
        [1.5, 10.0],
        "Without a heartbeat of the autopilot for this long, the link is lost and it holds.",
    ),
    real(
        "FH_SILENT",
        "s",
        5.0,
        [1.5, 30.0],
        "Without a heartbeat of the autopilot for this long, no setpoints are sent; at least FH_HB_TMO.",
    ),
    switch("FH_PRESTREAM", 1.0, "1: PX4 is sent zero velocity outside OFFBOARD, so that its pilot can enter OFFBOARD."),
    whole(
        "FH_OBS_FRAME",
        0.0,
        [0.0, 2.0],
        "Zero of the angles of OBSTACLE_DISTANCE: 0 the nose for ArduPilot, else as the message says; 1 as the message says; 2 the nose.",
    ),
    Param {
        unit: "%",
        ..whole(
            "FH_BAT_MIN",
            0.0,
            [0.0, 100.0],
            "It holds below this charge of the battery; 0: only on the autopilot's warnings.",
        )
    },
    whole("FH_RC_CH", 0.0, [0.0, 18.0], "RC channel that must be high for it to move; 0: none."),
    whole(
        "FH_SIGN",
        1.0,
        [0.0, 2.0],
        "With a signing key, unsigned messages are 0 accepted, 1 accepted until the first signed one, 2 refused.",
    ),
    switch("FH_V1", 0.0, "1: accepts MAVLink 1 also."),
    switch(
        "FH_YAW_MODE",
        0.0,
        "How setpoints turn the vehicle: 0 by yaw rate (type mask 0x05C7), 1 by absolute yaw (0x09C7).",
    ),
    switch("FH_LND_OUT", 0.0, "1: sends LANDING_TARGET."),
    switch("FH_OBS_OUT", 0.0, "1: sends its map of obstacles as OBSTACLE_DISTANCE."),
];
