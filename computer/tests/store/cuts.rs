//! The power goes.

use foxhound_computer::store::{Kept, Store};

use crate::flash::{Flash, PAGE_BYTES, Random};
use crate::model::{Deed, Model, calibration, parameters};

/// Starts, and looks that everything is as one of the two says.
fn check(flash: &mut Flash, old: &Model, new: &Model, at: impl std::fmt::Debug) -> Model {
    flash.restart();
    let mut store = Store::new(flash);
    let found = Model::found(&mut store);
    assert!(found.is_of(old, new), "{at:?}: found {found:?}\n of {old:?}\n or {new:?}");
    found
}

#[test]
fn whenever_the_power_goes_each_record_is_old_or_new_and_the_next_one_can_be_kept() {
    let mut random = Random(1);
    let (mut flash, mut model) = (Flash::new(2), Model::EMPTY);
    let (mut cuts, mut erased) = (0, 0);
    for round in 0..400 {
        let deed = Deed::any(&mut random);
        let after = model.after(&deed);
        // How far it goes with no cut.
        let mut whole = flash.clone();
        let before = whole.operations;
        let mut store = Store::new(&mut whole);
        let opened = Model::found(&mut store);
        assert_eq!(opened, model.after(&Deed::Begin), "round {round}");
        assert!(deed.is_done(&mut store, &model), "round {round}: {deed:?}");
        let count = whole.operations - before;
        for cut in 0..count {
            let mut torn = flash.clone();
            (torn.until_cut, torn.random) = (Some(cut), Random(random.next()));
            let mut store = Store::new(&mut torn);
            store.begin();
            deed.is_done(&mut store, &model);
            assert!(torn.is_off);
            let mut found = check(&mut torn, &model, &after.after(&Deed::Begin), (round, cut, &deed));
            cuts += 1;
            // And what was torn does not hinder what comes.
            let next = Deed::any(&mut random);
            let mut store = Store::new(&mut torn);
            found.starts += 1;
            assert_eq!(Model::found(&mut store), found);
            assert!(next.is_done(&mut store, &found), "round {round}, cut {cut}: {next:?}");
            let then = found.after(&next).after(&Deed::Begin);
            check(&mut torn, &then, &then, (round, cut, &deed, &next));
        }
        (flash, model) = (whole, opened.after(&deed));
        erased = flash.erased[3..].iter().sum();
    }
    assert!(cuts > 8_000 && erased > 50, "{cuts} cuts, {erased} pages came round");
}

/// An erase that was finished, but not struck out of the journal, would be done once more at the next start.
#[test]
fn a_word_that_is_refused_once_takes_nothing_away_from_what_is_kept_afterwards() {
    let mut random = Random(7);
    let (mut flash, mut model) = (Flash::new(8), Model::EMPTY);
    let mut refusals = 0;
    for round in 0..400 {
        let deed = Deed::any(&mut random);
        let after = model.after(&deed);
        let mut whole = flash.clone();
        let mut store = Store::new(&mut whole);
        let opened = Model::found(&mut store);
        assert!(deed.is_done(&mut store, &model), "round {round}: {deed:?}");
        for count in 0..40 {
            let mut other = flash.clone();
            let mut store = Store::new(&mut other);
            store.begin();
            other.until_refused = Some(count);
            let mut store = Store::new(&mut other);
            deed.is_done(&mut store, &model);
            if other.until_refused.take().is_some() {
                break;
            }
            refusals += 1;
            let mut store = Store::new(&mut other);
            let last = [
                Deed::Key(None),
                Deed::Parameters(parameters(&mut random)),
                Deed::Calibration(calibration(&mut random)),
            ];
            let kept = last.iter().fold(after, |model, deed| {
                assert!(deed.is_done(&mut store, &model), "round {round}, word {count}: {deed:?}");
                model.after(deed)
            });
            let found = Model::found(&mut Store::new(&mut other));
            assert_eq!(Model { starts: 0, ..found }, Model { starts: 0, ..kept }, "round {round}, word {count}");
        }
        (flash, model) = (whole, opened.after(&deed));
    }
    assert!(refusals > 1_000, "{refusals}");
}

#[test]
fn a_power_that_goes_again_and_again_never_gives_anything_but_old_or_new() {
    for seed in 0..60 {
        let mut random = Random(seed);
        let (mut flash, mut model) = (Flash::new(seed), Model::EMPTY);
        for round in 0..300 {
            let deed = Deed::any(&mut random);
            let after = model.after(&deed);
            // Often so soon that the start itself does not come to its end.
            let limit = if random.below(2) == 0 { 12 } else { 150 };
            flash.until_cut = Some(random.below(limit));
            let mut store = Store::new(&mut flash);
            store.begin();
            deed.is_done(&mut store, &model);
            let new = after.after(&Deed::Begin);
            model = check(&mut flash, &model, &new, (seed, round, &deed));
        }
        assert!(model.starts > 100, "seed {seed}: {} starts", model.starts);
        assert!(flash.erased[1..3].iter().all(|erased| *erased > 0), "{:?}", flash.erased);
    }
}

#[test]
fn a_power_that_goes_in_the_very_first_start_leaves_an_empty_store() {
    for seed in 0..200 {
        let mut flash = Flash::new(seed);
        flash.until_cut = Some(seed % 8);
        Store::new(&mut flash).begin();
        flash.restart();
        let found = Model::found(&mut Store::new(&mut flash));
        assert!(
            (1..=2).contains(&found.starts) && found == Model { starts: found.starts, ..Model::EMPTY },
            "{found:?}"
        );
    }
}

#[test]
fn pages_wear_evenly_and_a_timestamp_a_minute_lasts_for_years() {
    let mut flash = Flash::new(3);
    let mut store = Store::new(&mut flash);
    store.begin();
    let key = [7; 32];
    assert!(Deed::Key(Some(key)).is_done(&mut store, &Model::EMPTY));
    let model = Model { key: Kept::Found(key), ..Model::EMPTY };
    let minutes = 5000;
    for minute in 1..=minutes {
        assert!(Deed::Timestamp(minute).is_done(&mut store, &model));
    }
    assert_eq!(Model::found(&mut store).timestamp, minutes);
    let records = &flash.erased[3..];
    let (least, most) = (records.iter().min().unwrap(), records.iter().max().unwrap());
    assert!(most - least <= 1, "{records:?}");
    // The part is good for 10 000 cycles a page (DS12288, table of the flash's endurance). The journal is written once a page.
    assert!(u64::from(*most) * 5 * 60 < minutes, "at most once in five hours: {records:?}");
    // The marks are written as often, into two pages: two and a half hours a cycle are nearly three years of them.
    let marks = flash.erased[1..3].iter().max().unwrap();
    assert!(u64::from(*marks) * 150 < minutes, "{:?}", &flash.erased[1..3]);
    let erased: u32 = flash.erased[1..].iter().sum();
    assert!(flash.erased[0] <= erased / (PAGE_BYTES as u32 / 8) + 1);
}

#[test]
fn a_factory_reset_leaves_nothing_but_the_count_and_no_trace_of_the_key() {
    let mut random = Random(5);
    let mut flash = Flash::new(5);
    let mut model = Model::EMPTY;
    let key = 0xA55A_1234_5678_9ABC_u64;
    let secret: [u8; 32] = core::array::from_fn(|at| key.to_le_bytes()[at % 8]);
    let mut deeds: Vec<Deed> = (0..20).map(|_| Deed::Parameters(crate::model::parameters(&mut random))).collect();
    deeds.insert(3, Deed::Key(Some(secret)));
    let mut store = Store::new(&mut flash);
    for deed in &deeds {
        assert!(deed.is_done(&mut store, &model));
        model = model.after(deed);
    }
    let started = Model::found(&mut store).starts;
    assert!(Deed::Reset.is_done(&mut store, &model));
    assert_eq!(Model::found(&mut store), Model { starts: started + 1, ..Model::EMPTY });
    let bytes: Vec<u8> = flash.words.iter().flat_map(|word| word.to_le_bytes()).collect();
    assert!(!bytes.windows(8).any(|window| window == key.to_le_bytes()));
}
