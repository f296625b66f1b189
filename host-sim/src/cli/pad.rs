//! `foxhound pad`: runs the pad detector on a picture or on many, or trains its weights.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::BufReader;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use clap::Args;
use foxhound_core::landing::observation::{Pad, Seen};
use foxhound_pad::{Camera, Config, Format, HEIGHT_MAX, SIDE_MIN, WEIGHTS, WIDTH_MAX};
use foxhound_sim::scenario::input::{InputError, check_within};
use foxhound_sim::study::pad as study;
use foxhound_sim::world::camera::grounds::Grounds;
use foxhound_sim::world::camera::picture::{Picture, mark};
use foxhound_sim::world::camera::random::{Recipe, shot};
use foxhound_sim::world::camera::watch::alone;
use foxhound_sim::world::camera::{Frame, Size};
use serde::Serialize;

use super::terminal::{GOOD, HALF, say, show, show_as};
use super::value::number;
use super::{Cli, json_line, write_text};

const PAD_HELP: &str = "The picture is a PNG or a JPEG, seen by a camera that looks straight down: its top is towards the nose. It is scaled down to --size, \
by default to 160 columns, and shown to the detector twice, since the detector learns the light from the first. With --height the pad must have \
the size that it has from there.

With --grounds red discs are drawn by --seed onto parts of every second picture of a folder, in the light of the ground, and the shares found are
printed: of round discs, of such that lost their shape, and of parts without a disc. With --train weights are trained on the other pictures too, on from
those that fly.

Examples:
  foxhound pad --image field.png --height 2.5
  foxhound pad --image field.png --size 320x240 --json
  foxhound pad --render --seed 7 --out out    one that is drawn
  foxhound pad --grounds pictures             1 000 discs of each kind on real grounds
  foxhound pad --train --out out              new weights beside those that fly, into out/weights.rs; minutes

Exit status: 0 the pad is there; 1 it is not; 2 bad usage or input.";

#[derive(Args, Debug)]
#[command(after_help = PAD_HELP)]
pub(super) struct PadCommand {
    /// The picture, a PNG or a JPEG file.
    #[arg(long, value_name = "FILE", required_unless_present_any = ["render", "train", "grounds"])]
    image: Option<PathBuf>,
    /// Draws a scene with a pad by --seed instead.
    #[arg(long, conflicts_with_all = ["image", "height"])]
    render: bool,
    /// Trains new weights by --seed, and compares them with the current ones on drawn pictures new to both.
    #[arg(long, conflicts_with_all = ["image", "render", "height", "size", "grey", "focal", "radius"])]
    train: bool,
    /// Pictures of the ground from above, at least 160x120, without a pad; discs are drawn onto them.
    #[arg(long, value_name = "DIR", conflicts_with_all = ["image", "render", "height", "size", "grey", "focal", "radius"])]
    grounds: Option<PathBuf>,
    /// Height of the camera above the pad, in metres.
    #[arg(long, value_name = "M", value_parser = number(HEIGHT_M))]
    height: Option<f64>,
    /// Columns and lines for the detector.
    #[arg(long, value_name = "WxH")]
    size: Option<String>,
    /// Converts the picture to grey.
    #[arg(long)]
    grey: bool,
    /// Focal length over the picture's width.
    #[arg(long, value_name = "F", default_value_t = 0.866, value_parser = number(FOCAL))]
    focal: f64,
    /// Radius of the red disc, in metres.
    #[arg(long, value_name = "M", default_value_t = 0.25, value_parser = number(RADIUS_M))]
    radius: f64,
}

const HEIGHT_M: std::ops::RangeInclusive<f64> = 0.05..=1000.0;
const FOCAL: std::ops::RangeInclusive<f64> = 0.2..=5.0;
const RADIUS_M: std::ops::RangeInclusive<f64> = 0.02..=5.0;

#[derive(Serialize)]
struct Report {
    seen: &'static str,
    /// The reason, if there was no detection.
    reason: Option<String>,
    forward: Option<f32>,
    right: Option<f32>,
    radius: Option<f32>,
    confidence: Option<f32>,
    is_cut: Option<bool>,
    /// The centre, in pixels of the scaled picture.
    column_px: Option<f32>,
    row_px: Option<f32>,
    width_px: u16,
    height_px: u16,
    picture: Option<PathBuf>,
}

pub(super) fn pad(cli: &Cli, args: &PadCommand) -> Result<ExitCode, InputError> {
    if args.train {
        return train(cli, args.grounds.as_deref());
    }
    if let Some(folder) = &args.grounds {
        return examine(cli, folder);
    }
    check_within("--focal", args.focal, &FOCAL)?;
    check_within("--radius", args.radius, &RADIUS_M)?;
    if let Some(height_m) = args.height {
        check_within("--height", height_m, &HEIGHT_M)?;
    }
    let camera = Camera { focal_widths: args.focal as f32 };
    let config = Config { camera, pad_radius_m: args.radius as f32, ..Config::default() };
    let detector = config.build().map_err(|error| InputError::new(error.to_string()))?;
    let format = if args.grey { Format::Grey } else { Format::Rgb565 };
    let size = args.size.as_deref().map(sides).transpose()?;
    let (frame, height_m) = match &args.image {
        Some(path) => (read(path)?.frame(size, format), args.height.map(|height_m| height_m as f32)),
        None => {
            let [width_px, height_px] = size.unwrap_or([160, 120]);
            let size = Size { width_px, height_px, format };
            let shot = shot(&Recipe { size, pad_radius_m: config.pad_radius_m, ..Recipe::PAD }, &camera, cli.seed);
            (shot.frame, Some(shot.pose.height_m))
        }
    };
    if frame.size.width_px < SIDE_MIN || frame.size.height_px < SIDE_MIN {
        let Size { width_px, height_px, .. } = frame.size;
        return Err(InputError::new(format!(
            "--image: {width_px}x{height_px} pixels are too few, {SIDE_MIN} a side are needed"
        )));
    }
    let seen = alone(&detector, &frame, height_m, 2).seen;
    let mut report = report(seen, &frame, args.focal as f32);
    if let Some(folder) = &cli.out {
        let path = folder.join("pad.png");
        cli.claim(&path)?;
        mark(&frame, seen, args.focal as f32).write(&path)?;
        report.picture = Some(path);
    }
    let code = u8::from(!matches!(seen, Seen::Pad(_)));
    if cli.json {
        say(&json_line(&report)?);
    } else {
        show_as(if code == 0 { GOOD } else { HALF }, &text(seen, &report));
    }
    Ok(ExitCode::from(code))
}

fn read_grounds(folder: &Path) -> Result<[Grounds; 2], InputError> {
    Grounds::read(folder).map_err(|error| InputError::new(format!("--grounds {error}")))
}

fn examine(cli: &Cli, folder: &Path) -> Result<ExitCode, InputError> {
    let [_, grounds] = read_grounds(folder)?;
    let progress = cli.spinner("looking");
    let rows = study::grounds::measure(&grounds, &WEIGHTS, cli.seed);
    progress.finish_and_clear();
    let rows = rows?;
    if cli.json {
        say(&json_line(&rows)?);
    } else {
        show(&study::grounds::table(&rows));
    }
    Ok(ExitCode::SUCCESS)
}

fn train(cli: &Cli, folder: Option<&Path>) -> Result<ExitCode, InputError> {
    let out = cli.out.clone().or_else(|| (!cli.json).then(|| PathBuf::from("out")));
    let grounds = folder.map(read_grounds).transpose()?.map(|[grounds, _]| grounds);
    let progress = cli.spinner("training");
    let [first, _] = &WEIGHTS;
    let trained = study::Lessons::draw(grounds.as_ref()).and_then(|lessons| {
        let weights = lessons.train(grounds.is_some().then_some(first), cli.seed);
        let reports =
            [("flown", study::Report::of(&WEIGHTS)?), ("trained", study::Report::of(std::slice::from_ref(&weights))?)];
        Ok((weights, reports))
    });
    progress.finish_and_clear();
    let (weights, reports) = trained?;
    if cli.json {
        say(&json_line(&BTreeMap::from(reports))?);
    } else {
        show(&study::table(&reports));
    }
    if let Some(out) = out {
        let path = out.join("weights.rs");
        write_text(&path, &study::source(&weights, cli.seed))?;
        cli.note(&format!("written: {}", path.display()));
    }
    Ok(ExitCode::SUCCESS)
}

/// Columns and lines.
fn sides(text: &str) -> Result<[u16; 2], InputError> {
    let refused = || {
        InputError::new(format!(
            "--size {text}: expected WxH, such as 160x120, from {SIDE_MIN}x{SIDE_MIN} to {WIDTH_MAX}x{HEIGHT_MAX}"
        ))
    };
    let (width, height) = text.split_once('x').ok_or_else(refused)?;
    let side = |text: &str, most: u16| text.parse().ok().filter(|side| (SIDE_MIN..=most).contains(side));
    Ok([side(width, WIDTH_MAX).ok_or_else(refused)?, side(height, HEIGHT_MAX).ok_or_else(refused)?])
}

fn read(path: &Path) -> Result<Picture, InputError> {
    let failed = |error: String| InputError::new(format!("--image {}: {error}", path.display()));
    let file = File::open(path).map_err(|error| failed(error.to_string()))?;
    Picture::read(BufReader::new(file)).map_err(failed)
}

fn report(seen: Seen, frame: &Frame, focal_widths: f32) -> Report {
    let (name, reason) = match seen {
        Seen::Pad(_) => ("pad", None),
        Seen::Nothing(why) => ("nothing", Some(format!("{why:?}").to_lowercase())),
        Seen::Bad(bad) => ("bad", Some(format!("{bad:?}").to_lowercase())),
    };
    let pad = match seen {
        Seen::Pad(pad) => Some(pad),
        _ => None,
    };
    let Size { width_px, height_px, .. } = frame.size;
    let focal_px = focal_widths * f32::from(width_px);
    let of = |value: fn(&Pad) -> f32| pad.as_ref().map(value);
    Report {
        seen: name,
        reason,
        forward: of(|pad| pad.forward),
        right: of(|pad| pad.right),
        radius: of(|pad| pad.radius),
        confidence: of(|pad| pad.confidence),
        is_cut: pad.map(|pad| pad.is_cut),
        column_px: pad.map(|pad| 0.5 * f32::from(width_px) + pad.right * focal_px),
        row_px: pad.map(|pad| 0.5 * f32::from(height_px) - pad.forward * focal_px),
        width_px,
        height_px,
        picture: None,
    }
}

fn text(seen: Seen, report: &Report) -> String {
    let mut text = match seen {
        Seen::Pad(pad) => format!(
            "the pad\n  forward     {:.3} (metres a metre down)\n  right       {:.3}\n  radius      {:.3}\n  confidence  {:.2}\n{}",
            pad.forward,
            pad.right,
            pad.radius,
            pad.confidence,
            if pad.is_cut { "  the picture's border cuts it\n" } else { "" }
        ),
        Seen::Nothing(_) => format!("no pad: {}\n", report.reason.as_deref().unwrap_or_default()),
        Seen::Bad(_) => format!("no good picture: {}\n", report.reason.as_deref().unwrap_or_default()),
    };
    if let Some(path) = &report.picture {
        text.push_str(&format!("  picture     {}\n", path.display()));
    }
    text
}
