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

#[test]
fn the_seed_decides_alone_and_every_experiment_is_in_the_table_and_the_picture() {
    let [report, again, other] = [3, 3, 4].map(|seed| run_with(seed, 10).unwrap());
    let json = |report: &Report| serde_json::to_string(report).unwrap();
    assert_eq!(json(&report), json(&again));
    assert_ne!(json(&report), json(&other));
    let table = report.table();
    for row in &report.rows {
        assert!(table.contains(row.label), "{table}");
        assert!(row.ours.median_m.is_finite() && row.ours.lost == 0, "{row:?}");
        assert_eq!(row.ours.converged.is_some(), row.name.contains("unknown"));
    }
    let folder = std::env::temp_dir().join(format!("foxhound-localize-{}", std::process::id()));
    let path = folder.join("filters.svg");
    report.draw(&path).unwrap();
    let svg = std::fs::read_to_string(&path).unwrap();
    std::fs::remove_dir_all(&folder).unwrap();
    assert!(svg.contains("(fig. 2)") && svg.contains("(fig. 3)") && svg.contains("polyline"));
}

#[test]
fn a_wall_without_slope_is_refused_by_the_papers_filter_only() {
    let report = run_with(5, 10).unwrap();
    let row = report.rows.iter().find(|row| row.name == "nlos_vertical").unwrap();
    let paper = row.paper.as_ref().unwrap();
    assert_eq!((paper.lost, paper.nis.verdict), (10, Verdict::TooFew));
    assert!(row.ours.median_m < 3.0, "{row:?}");
}
