//! The parameters that are asked for by name, as constants.
#![expect(missing_docs, reason = "the table says it")]

use super::Id;

pub const FH_SPD_MAX: Id = Id::of("FH_SPD_MAX");
pub const FH_LAG: Id = Id::of("FH_LAG");
pub const FH_RADIUS: Id = Id::of("FH_RADIUS");
pub const FH_MARGIN_TGT: Id = Id::of("FH_MARGIN_TGT");
pub const FH_OBS_FOV: Id = Id::of("FH_OBS_FOV");
pub const FH_OBS_RANGE: Id = Id::of("FH_OBS_RANGE");
pub const FH_OBS_SRC: Id = Id::of("FH_OBS_SRC");
pub const FH_LDR_YAW: Id = Id::of("FH_LDR_YAW");
pub const FH_RPL_WPT: Id = Id::of("FH_RPL_WPT");
pub const FH_SRCH_TIME: Id = Id::of("FH_SRCH_TIME");
pub const FH_SRCH_R: Id = Id::of("FH_SRCH_R");
pub const FH_BRG_SRC: Id = Id::of("FH_BRG_SRC");
pub const FH_BRG_TAG: Id = Id::of("FH_BRG_TAG");
pub const FH_BRG_YAW: Id = Id::of("FH_BRG_YAW");
pub const FH_BRG_SIGMA: Id = Id::of("FH_BRG_SIGMA");
pub const FH_ARR_SIDE: Id = Id::of("FH_ARR_SIDE");
pub const FH_CAL_REQ: Id = Id::of("FH_CAL_REQ");
pub const FH_TONE: Id = Id::of("FH_TONE");
pub const FH_TURN: Id = Id::of("FH_TURN");
pub const FH_TURN_RATE: Id = Id::of("FH_TURN_RATE");
pub const FH_TURN_CH: Id = Id::of("FH_TURN_CH");
pub const FH_LND_MODE: Id = Id::of("FH_LND_MODE");
pub const FH_LND_REQ: Id = Id::of("FH_LND_REQ");
pub const FH_PAD_R: Id = Id::of("FH_PAD_R");
pub const FH_CAM_FOCAL: Id = Id::of("FH_CAM_FOCAL");
pub const FH_SP_AGE: Id = Id::of("FH_SP_AGE");
pub const FH_HB_TMO: Id = Id::of("FH_HB_TMO");
pub const FH_SILENT: Id = Id::of("FH_SILENT");
pub const FH_PRESTREAM: Id = Id::of("FH_PRESTREAM");
pub const FH_OBS_FRAME: Id = Id::of("FH_OBS_FRAME");
pub const FH_BAT_MIN: Id = Id::of("FH_BAT_MIN");
pub const FH_RC_CH: Id = Id::of("FH_RC_CH");
pub const FH_FENCE_R: Id = Id::of("FH_FENCE_R");
pub const FH_SIGN: Id = Id::of("FH_SIGN");
pub const FH_V1: Id = Id::of("FH_V1");
pub const FH_YAW_MODE: Id = Id::of("FH_YAW_MODE");
pub const FH_LND_OUT: Id = Id::of("FH_LND_OUT");
pub const FH_OBS_OUT: Id = Id::of("FH_OBS_OUT");
