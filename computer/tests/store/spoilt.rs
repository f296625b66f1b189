//! Bits change, and anything stands in the flash.

use foxhound_computer::flight::ParameterStore as _;
use foxhound_computer::store::{Kept, PAGES, Store};

use crate::flash::{Flash, PAGE_BYTES, Random};
use crate::model::{Deed, Model, calibration, parameters};

const WORDS: u64 = PAGES as u64 * PAGE_BYTES as u64 / 8;
/// Words that a start may read and write, whatever is in the flash.
const READS_MAX: u64 = 400_000;
const WRITES_MAX: u64 = 3_000;

#[test]
fn flipped_bits_give_what_was_once_kept_or_a_loss_and_never_anything_else() {
    let mut random = Random(11);
    let (mut flash, mut model) = (Flash::new(12), Model::EMPTY);
    let mut past = vec![model];
    let mut store = Store::new(&mut flash);
    // No reset, so that there is something to lose.
    let deeds = core::iter::repeat_with(|| Deed::any(&mut random)).filter(|deed| !matches!(deed, Deed::Reset));
    for deed in deeds.take(120).collect::<Vec<_>>() {
        assert!(deed.is_done(&mut store, &model));
        model = model.after(&deed);
        past.push(model);
    }
    let (mut losses, mut older, mut same) = (0, 0, 0);
    for round in 0..3000 {
        let mut spoilt = flash.clone();
        let flips = 1 + random.below(1 << (round % 8));
        for _ in 0..flips {
            let at = random.below(WORDS) as usize;
            spoilt.words[at] ^= 1 << random.below(64);
        }
        let mut store = Store::new(&mut spoilt);
        let found = Model::found(&mut store);
        let was = |part: &dyn Fn(&Model) -> bool| past.iter().any(part);
        assert!(found.parameters == Kept::Lost || was(&|model| model.parameters == found.parameters), "{round}");
        assert!(found.calibration == Kept::Lost || was(&|model| model.calibration == found.calibration), "{round}");
        assert!(found.key == Kept::Lost || was(&|model| model.key == found.key), "{round}");
        assert!(found.timestamp == 0 || was(&|model| model.timestamp == found.timestamp), "{round}");
        match found.parameters {
            Kept::Lost => losses += 1,
            parameters if parameters == model.parameters => same += 1,
            // It takes two: one in the record and one in its mark.
            _ => {
                assert!(flips > 1, "{round}");
                older += 1;
            }
        }
        // A loss can be made good.
        let values = parameters(&mut random);
        assert!(store.save(&values), "{round}");
        assert_eq!(Model::found(&mut store).parameters, Kept::Found(values), "{round}");
    }
    assert!(same > 1000 && losses > 10 * older, "{same} the same, {older} older, {losses} lost");
}

/// What of it is lost now, if everything else is as it was; none where something is older than it was.
fn lost(found: &Model, before: &Model) -> Option<Vec<&'static str>> {
    let starts = (before.starts..=before.starts + 1).contains(&found.starts);
    let parts = [
        ("parameters", found.parameters == before.parameters, found.parameters == Kept::Lost),
        ("calibration", found.calibration == before.calibration, found.calibration == Kept::Lost),
        ("key", found.key == before.key, found.key == Kept::Lost),
        ("timestamp", found.timestamp == before.timestamp, found.timestamp == 0),
    ];
    let is_sound = starts && parts.iter().all(|(_, is_same, is_lost)| *is_same || *is_lost);
    is_sound.then(|| parts.into_iter().filter(|(_, is_same, _)| !is_same).map(|(name, ..)| name).collect())
}

/// A store in which everything was kept a few times, and the model of it.
fn used(random: &mut Random) -> (Flash, Model) {
    let (mut flash, mut model) = (Flash::new(random.next()), Model::EMPTY);
    let mut store = Store::new(&mut flash);
    for round in 0..3 + random.below(40) {
        let key = core::array::from_fn(|_| random.next() as u8 | 1);
        let deeds = [
            Deed::Begin,
            Deed::Parameters(parameters(random)),
            Deed::Calibration(calibration(random)),
            Deed::Key(Some(key)),
            Deed::Timestamp(1 + round),
        ];
        for deed in deeds {
            assert!(deed.is_done(&mut store, &model));
            model = model.after(&deed);
        }
    }
    (flash, model)
}

#[test]
fn a_flipped_bit_in_the_newest_record_is_a_loss_of_it_and_never_a_step_back() {
    let mut random = Random(61);
    for _ in 0..3 {
        let (flash, model) = used(&mut random);
        let key = core::array::from_fn(|_| random.next() as u8 | 1);
        for (name, deed) in [
            ("parameters", Deed::Parameters(parameters(&mut random))),
            ("calibration", Deed::Calibration(calibration(&mut random))),
            ("timestamp", Deed::Timestamp(1 << 40)),
            ("key", Deed::Key(Some(key))),
            ("key", Deed::Key(None)),
            ("", Deed::Begin),
        ] {
            let mut written = flash.clone();
            let mut store = Store::new(&mut written);
            assert!(store.begin() > 0 && deed.is_done(&mut store, &model));
            let after = model.after(&Deed::Begin).after(&deed);
            let changed: Vec<usize> =
                (0..written.words.len()).filter(|at| written.words[*at] != flash.words[*at]).collect();
            let mut losses = 0;
            for at in changed {
                for bit in 0..64 {
                    let mut spoilt = written.clone();
                    spoilt.words[at] ^= 1 << bit;
                    let mut store = Store::new(&mut spoilt);
                    let found = Model::found(&mut store);
                    let why = format!("{deed:?}, word {at}, bit {bit}");
                    let gone = lost(&found, &after).unwrap_or_else(|| panic!("{why}: {found:?} of {after:?}"));
                    assert!(
                        gone.iter().all(|gone| gone.contains(name) || (name == "key" && *gone == "timestamp")),
                        "{why}: {gone:?}"
                    );
                    losses += usize::from(!gone.is_empty());
                    // Told again at the next start, until it is kept anew.
                    if bit == 0 {
                        let again = after.after(&Deed::Begin);
                        assert_eq!(lost(&Model::found(&mut store), &again), Some(gone), "{why}");
                    }
                }
            }
            let least = if name.is_empty() { 0 } else { 64 };
            assert!(losses >= least, "{deed:?}: {losses} losses");
        }
    }
}

#[test]
fn a_flipped_bit_anywhere_gives_what_was_kept_last_or_a_loss() {
    let mut random = Random(71);
    for _ in 0..4 {
        let (flash, model) = used(&mut random);
        for at in 0..flash.words.len() {
            let mut spoilt = flash.clone();
            spoilt.words[at] ^= 1 << random.below(64);
            let found = Model::found(&mut Store::new(&mut spoilt));
            assert!(lost(&found, &model.after(&Deed::Begin)).is_some(), "word {at}: {found:?} of {model:?}");
        }
    }
}

#[test]
fn parameters_whose_only_copy_is_damaged_are_lost_and_not_forgotten() {
    let mut random = Random(21);
    let mut flash = Flash::new(22);
    let mut store = Store::new(&mut flash);
    store.begin();
    assert!(store.save(&parameters(&mut random)));
    // The first record of the first page.
    let first = 3 * PAGE_BYTES / 8 + 1;
    // Its header, and its content but for the last word, half of which is filling.
    for at in first..first + 59 {
        let mut spoilt = flash.clone();
        spoilt.words[at] ^= 1 << random.below(64);
        let mut store = Store::new(&mut spoilt);
        let found = Model::found(&mut store);
        assert_eq!((found.parameters, found.calibration), (Kept::Lost, Kept::Nothing), "word {at}");
        assert_eq!(Model::found(&mut store).parameters, Kept::Lost, "told again at the next start");
        assert!(store.reset());
        assert_eq!(Model::found(&mut store).parameters, Kept::Nothing);
    }
}

#[test]
fn a_count_of_starts_that_cannot_be_read_makes_what_is_missing_lost() {
    let mut flash = Flash::new(31);
    let mut store = Store::new(&mut flash);
    store.begin();
    let values = parameters(&mut Random(32));
    assert!(store.save(&values));
    flash.words[PAGE_BYTES / 8..3 * PAGE_BYTES / 8].fill(0x1234_5678_9abc_def0);
    let found = Model::found(&mut Store::new(&mut flash));
    assert_eq!(found.parameters, Kept::Found(values), "it is there");
    assert_eq!((found.starts, found.calibration, found.key), (1, Kept::Lost, Kept::Lost), "nobody knows");
}

/// A flash with anything in it.
fn anything(random: &mut Random, seed: &Flash) -> Flash {
    let mut flash = seed.clone();
    let kind = random.below(6);
    for at in 0..flash.words.len() {
        let old = flash.words[at];
        flash.words[at] = match kind {
            0 => random.next(),
            1 => 0,
            // Few bits set, few bits clear: lengths and marks that look like something.
            2 => random.next() & random.next() & random.next(),
            3 => random.next() | random.next() | random.next(),
            // Whole words of a real store in other places.
            4 => seed.words[random.below(WORDS) as usize],
            _ if random.below(4) == 0 => random.next(),
            _ => old,
        };
    }
    // Pages of a real store in another order.
    if random.below(3) == 0 {
        let pages = PAGES as usize;
        let order: Vec<usize> = (0..pages).map(|_| random.below(pages as u64) as usize).collect();
        let size = PAGE_BYTES / 8;
        let source = if random.below(2) == 0 { seed.words.clone() } else { flash.words.clone() };
        for (to, from) in order.into_iter().enumerate() {
            flash.words[to * size..][..size].copy_from_slice(&source[from * size..][..size]);
        }
    }
    flash
}

#[test]
fn anything_in_the_flash_gives_an_end_and_a_store_that_keeps() {
    let mut random = Random(41);
    let (mut seed, mut model) = (Flash::new(42), Model::EMPTY);
    let mut store = Store::new(&mut seed);
    for _ in 0..90 {
        let deed = Deed::any(&mut random);
        assert!(deed.is_done(&mut store, &model));
        model = model.after(&deed);
    }
    for round in 0..2000 {
        let mut flash = anything(&mut random, &seed);
        (flash.reads, flash.operations) = (0, 0);
        let mut store = Store::new(&mut flash);
        Model::found(&mut store);
        let values = parameters(&mut random);
        assert!(store.save(&values), "round {round}");
        assert_eq!(Model::found(&mut store).parameters, Kept::Found(values), "round {round}");
        assert!(flash.reads < READS_MAX && flash.operations < WRITES_MAX, "{} {}", flash.reads, flash.operations);
    }
}

#[test]
fn a_flash_that_refuses_everything_is_a_loss_and_no_panic() {
    let mut flash = Flash::new(51);
    flash.is_off = true;
    let mut store = Store::new(&mut flash);
    assert_eq!(
        Model::found(&mut store),
        Model { starts: 0, parameters: Kept::Lost, calibration: Kept::Lost, key: Kept::Lost, timestamp: 0 }
    );
    assert!(!store.save(&parameters(&mut Random(52))) && !store.reset() && store.load().is_none());
}
