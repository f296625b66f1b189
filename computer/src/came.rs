//! What the bytes of a radio become.

use foxhound_core::doa::bearing::Bearing;

/// What has come.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Came {
    /// A bearing.
    Bearing(Bearing),
    /// Something of another tag.
    Other,
    /// A report without a direction.
    #[cfg_attr(not(feature = "iq"), expect(dead_code, reason = "of reports alone"))]
    Unclear,
    /// What cannot be read.
    Refused,
}
