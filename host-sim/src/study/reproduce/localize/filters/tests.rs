use super::*;

#[test]
fn over_seeds_our_filter_is_inside_its_bands_as_often_as_bands_of_95_per_cent_say() {
    let mut outside = 0;
    for seed in 1..=5 {
        for row in run(seed).unwrap().rows.iter().filter(|row| row.name.starts_with("los_")) {
            for normalised in [&row.ours.nis, &row.ours.nees] {
                let [low, high] = normalised.band;
                let inside = normalised.mean >= low && normalised.mean <= high;
                assert_eq!(inside, normalised.verdict == Verdict::Consistent, "{row:?}");
                // Nothing is far off: a band reaches 1.96 standard deviations, 3.5 of them are once in 2000.
                let centre = 0.5 * (low + high);
                assert!((normalised.mean - centre).abs() < 3.5 / 1.96 * 0.5 * (high - low), "{seed}: {row:?}");
                outside += usize::from(!inside);
            }
        }
    }
    // Of 40, two on average; more than five are once in 70.
    assert!(outside <= 5, "{outside}");
}
