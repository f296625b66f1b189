use super::*;

const G474_HZ: u32 = 170_000_000;
const TWIN_HZ: u32 = 25_000_000;

#[test]
fn the_lines_are_within_one_percent_of_921_600_baud() {
    let rates = [
        (G474_HZ, 1, 184),
        // LPUART: 256 times finer.
        (G474_HZ, 256, 47_222),
        (TWIN_HZ, 1, 27),
    ];
    for (clock_hz, parts, divider) in rates {
        assert_eq!(baud_divider(clock_hz, 921_600, parts), divider);
        let baud = f64::from(clock_hz) * f64::from(parts) / f64::from(divider);
        assert!((baud / 921_600.0 - 1.0).abs() < 0.01, "{baud}");
    }
}

#[test]
fn crystal_and_internal_oscillator_make_the_same_clock() {
    assert_eq!(pll_hz(24_000_000, 6, 85, 2), G474_HZ);
    assert_eq!(pll_hz(16_000_000, 4, 85, 2), G474_HZ);
    assert_eq!(prescaler(G474_HZ, 1_000_000), 169);
    assert_eq!(prescaler(16_000_000, 1_000_000), 15);
}

#[test]
fn a_count_goes_on_over_the_wrap() {
    assert_eq!(wide_count(0, u32::MAX) + 1, wide_count(1, 0));
    assert_eq!(wide_count(u32::MAX, u32::MAX), u64::MAX);
}

#[test]
fn an_alarm_is_set_ahead_of_now_only_and_no_further_than_the_timer_counts() {
    assert_eq!(alarm_count(100, 101, 25), Some(25));
    assert_eq!(alarm_count(100, 100, 25), None);
    assert_eq!(alarm_count(100, 99, 25), None);
    // 171 s.
    assert_eq!(alarm_count(0, 171_798_691, 25), Some(4_294_967_275));
    assert_eq!(alarm_count(0, 171_798_692, 25), Some(u32::MAX));
    assert_eq!(alarm_count(0, u64::MAX - 1, 25), Some(u32::MAX));
}

#[test]
fn a_frame_is_dated_by_its_middle_and_waited_for_twice() {
    // 127.5 samples of 1660 cycles are 1245 us.
    assert_eq!(half_block_us(256, 1660, 170), 1245);
    assert_eq!(half_block_us(256, 1661, 170), 1246);
    // Eight blocks of 2.5 ms are a frame: 19.998 ms.
    assert_eq!(patience_us(8 * 256 * 1660, 170), 40_996);
    assert_eq!(patience_us(0, 170), 1_000);
}

#[test]
fn the_half_that_is_read_is_the_one_that_is_not_written() {
    // The counter stands at the length where it begins anew, and at half of it when the first half is full.
    assert_eq!([512, 511, 257, 256, 255, 1].map(|left| ring_half(left, 256)), [1, 1, 1, 0, 0, 0]);
}

#[test]
fn a_region_of_32_kb_has_the_size_that_the_manual_says() {
    assert_eq!(region_size(32 << 10), 14 << 1);
    assert_eq!(region_size(32), 4 << 1);
}
