use super::*;
#[test]
fn the_state_is_below_two_kilobytes() {
    assert!(size_of::<State>() <= 2048, "{}", size_of::<State>());
}
