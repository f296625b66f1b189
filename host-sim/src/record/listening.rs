//! The page of `foxhound listen`: bearings over time with their sigma, spectrum, eigenvalues, in one HTML file.

use std::fmt::Write as _;

/// A bearing on the page.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Point {
    /// Time in seconds of a live radio; number of the frame of a recording.
    pub at: f64,
    /// Number of the transmitter.
    pub emitter: i32,
    /// Azimuth, degrees.
    pub azimuth_deg: f64,
    /// Its standard deviation.
    pub sigma_deg: f64,
    /// Whether it is valid.
    pub is_valid: bool,
    /// Whether it is flagged as more than one wave.
    pub is_flagged: bool,
}

/// Contents of the page.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Page {
    /// File or source.
    pub title: String,
    /// Description of what was read.
    pub taken: String,
    /// Unit of the time axis.
    pub unit: &'static str,
    /// Number of results, including those without a direction.
    pub answers: usize,
    /// The bearings.
    pub points: Vec<Point>,
    /// Eigenvalues at the time of each answer, largest first.
    pub eigenvalues: Vec<(f64, Vec<f64>)>,
    /// Frequency and power in dB.
    pub spectrum: Vec<[f64; 2]>,
    /// The occupied band.
    pub band_hz: Option<[f64; 2]>,
}

const STYLE: &str = "body{font:15px/1.5 system-ui,sans-serif;margin:2rem auto;max-width:62rem;padding:0 1rem;color:#1f2937;background:#fff}\
svg{width:100%;height:auto;background:#f7f8fa;border:1px solid #e4e7ec}text{font-size:11px;fill:#6b7280}\
@media(prefers-color-scheme:dark){body{color:#e5e7eb;background:#111827}svg{background:#1f2937;border-color:#374151}}";
const COLOURS: [&str; 8] = ["#2563eb", "#dc2626", "#059669", "#d97706", "#7c3aed", "#0891b2", "#be185d", "#4d7c0f"];
/// Size of a chart, and of the space for its axes.
const SIZE: [f64; 2] = [900.0, 260.0];
const EDGE: [f64; 2] = [48.0, 24.0];
/// Largest number of points of a chart; of more, every n-th is shown, and the page says so.
const POINTS_MAX: usize = 4000;

/// A chart; `x` and `y` are the ranges of its axes.
struct Chart {
    svg: String,
    x: [f64; 2],
    y: [f64; 2],
}

impl Chart {
    fn new(x: [f64; 2], y: [f64; 2], names: [&str; 2]) -> Self {
        let wide = |[least, most]: [f64; 2]| if most > least { [least, most] } else { [least - 0.5, least + 0.5] };
        let mut chart = Self { svg: String::new(), x: wide(x), y: wide(y) };
        let [width, height] = SIZE;
        let _ = write!(
            chart.svg,
            "<svg viewBox=\"0 0 {width} {height}\" role=\"img\" aria-label=\"{} over {}\">",
            names[1], names[0]
        );
        for part in 0..=4 {
            let share = f64::from(part) / 4.0;
            let (x, y) =
                (chart.x[0] + share * (chart.x[1] - chart.x[0]), chart.y[0] + share * (chart.y[1] - chart.y[0]));
            let [px, py] = [chart.at(x, y)[0], chart.at(x, y)[1]];
            let (bottom, left) = (height - EDGE[1] + 14.0, EDGE[0] - 5.0);
            let _ = write!(
                chart.svg,
                "<text x=\"{px:.1}\" y=\"{bottom}\" text-anchor=\"middle\">{}</text><text x=\"{left}\" y=\"{py:.1}\" text-anchor=\"end\">{}</text>\
                 <line x1=\"{}\" x2=\"{width}\" y1=\"{py:.1}\" y2=\"{py:.1}\" stroke=\"#9ca3af\" stroke-opacity=\".4\"/>",
                short(x),
                short(y),
                EDGE[0]
            );
        }
        let _ = write!(chart.svg, "<text x=\"{}\" y=\"12\">{}; {}</text>", EDGE[0] + 4.0, names[1], names[0]);
        chart
    }

    fn at(&self, x: f64, y: f64) -> [f64; 2] {
        let share = |value: f64, [least, most]: [f64; 2]| ((value - least) / (most - least)).clamp(0.0, 1.0);
        let [width, height] = SIZE;
        [
            EDGE[0] + share(x, self.x) * (width - EDGE[0] - 8.0),
            height - EDGE[1] - share(y, self.y) * (height - EDGE[1] - 18.0),
        ]
    }

    fn path(&mut self, points: impl Iterator<Item = [f64; 2]>, colour: &str) {
        self.svg.push_str("<polyline fill=\"none\" stroke-width=\"1.2\" stroke=\"");
        let _ = write!(self.svg, "{colour}\" points=\"");
        for [x, y] in points {
            let [px, py] = self.at(x, y);
            let _ = write!(self.svg, "{px:.1},{py:.1} ");
        }
        self.svg.push_str("\"/>");
    }

    fn end(mut self) -> String {
        self.svg.push_str("</svg>\n");
        self.svg
    }
}

/// A number with few digits.
fn short(value: f64) -> String {
    match value.abs() {
        size if size >= 1e6 => format!("{:.3}M", value / 1e6),
        size if size >= 1e4 => format!("{:.1}k", value / 1e3),
        size if size >= 100.0 => format!("{value:.0}"),
        _ => format!("{value:.1}"),
    }
}

/// A text that is no markup.
pub(crate) fn text(words: &str) -> String {
    words.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

/// Renders the page.
#[must_use]
pub fn page(page: &Page) -> String {
    let mut html = String::from("<!doctype html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n");
    html.push_str("<meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n<link rel=\"icon\" href=\"data:,\">\n");
    let _ =
        write!(html, "<title>{}</title>\n<style>{STYLE}</style>\n</head>\n<body>\n<h1>{0}</h1>\n", text(&page.title));
    let valid = page.points.iter().filter(|point| point.is_valid).count();
    let flagged = page.points.iter().filter(|point| point.is_flagged).count();
    let _ = writeln!(
        html,
        "<p>{}. {} answers: {valid} valid, {} without a direction, {flagged} flagged as more than one wave.</p>",
        text(&page.taken),
        page.answers,
        page.answers.saturating_sub(page.points.len())
    );
    bearings(&mut html, page);
    spectrum(&mut html, page);
    eigenvalues(&mut html, page);
    html.push_str("</body>\n</html>\n");
    html
}

/// Every how many-th of `count` points is shown.
fn thinned(html: &mut String, count: usize) -> usize {
    let step = count.div_ceil(POINTS_MAX).max(1);
    if step > 1 {
        let _ = writeln!(html, "<p>One of {step} is shown.</p>");
    }
    step
}

fn bearings(html: &mut String, page: &Page) {
    html.push_str("<h2>Bearings</h2>\n");
    if page.points.is_empty() {
        html.push_str("<p>None.</p>\n");
        return;
    }
    html.push_str("<p>Azimuth from the nose, clockwise, with one sigma up and down; faint where it is not valid; a colour for each transmitter.</p>\n");
    let step = thinned(html, page.points.len());
    let ends = page.points.iter().fold([f64::MAX, f64::MIN], |[a, b], point| [a.min(point.at), b.max(point.at)]);
    let mut chart = Chart::new(ends, [-180.0, 180.0], [page.unit, "degrees"]);
    let mut emitters: Vec<i32> = page.points.iter().map(|point| point.emitter).collect();
    emitters.sort_unstable();
    emitters.dedup();
    for point in page.points.iter().step_by(step) {
        let number = emitters.binary_search(&point.emitter).unwrap_or_default();
        let colour = COLOURS[number % COLOURS.len()];
        let opacity = if point.is_valid { 0.9 } else { 0.2 };
        let [x, y] = chart.at(point.at, point.azimuth_deg);
        let [_, top] = chart.at(point.at, point.azimuth_deg + point.sigma_deg);
        let [_, bottom] = chart.at(point.at, point.azimuth_deg - point.sigma_deg);
        let _ = write!(
            chart.svg,
            "<g stroke=\"{colour}\" fill=\"{colour}\" opacity=\"{opacity}\"><line x1=\"{x:.1}\" x2=\"{x:.1}\" y1=\"{top:.1}\" y2=\"{bottom:.1}\" \
             stroke-opacity=\".5\"/><circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"2\"/></g>"
        );
    }
    html.push_str(&chart.end());
}

fn spectrum(html: &mut String, page: &Page) {
    if page.spectrum.is_empty() {
        return;
    }
    html.push_str("<h2>Spectrum</h2>\n<p>All channels, relative to the strongest line; the band that is listened to is shaded.</p>\n");
    let ends = [page.spectrum[0][0], page.spectrum[page.spectrum.len() - 1][0]];
    let least = page.spectrum.iter().map(|[_, db]| *db).fold(0.0, f64::min);
    let mut chart = Chart::new(ends, [least.max(-120.0), 0.0], ["Hz", "dB"]);
    if let Some([low_hz, high_hz]) = page.band_hz {
        let ([left, _], [right, _]) = (chart.at(low_hz, 0.0), chart.at(high_hz, 0.0));
        let _ = write!(
            chart.svg,
            "<rect x=\"{left:.1}\" y=\"18\" width=\"{:.1}\" height=\"{}\" fill=\"#2563eb\" opacity=\".12\"/>",
            (right - left).max(1.0),
            SIZE[1] - EDGE[1] - 18.0
        );
    }
    chart.path(page.spectrum.iter().copied(), COLOURS[0]);
    html.push_str(&chart.end());
}

fn eigenvalues(html: &mut String, page: &Page) {
    let Some((_, first)) = page.eigenvalues.first() else { return };
    html.push_str(
        "<h2>Eigenvalues of the covariance</h2>\n<p>In dB, each over time. One far above the others: one wave. Two: a second emitter or a \
         reflection. All alike: noise.</p>\n",
    );
    let step = thinned(html, page.eigenvalues.len());
    let db = |value: f64| 10.0 * value.max(1e-30).log10();
    let all = page.eigenvalues.iter().flat_map(|(_, values)| values).map(|value| db(*value));
    let [least, most] = all.fold([f64::MAX, f64::MIN], |[a, b], value| [a.min(value), b.max(value)]);
    let ends = page.eigenvalues.iter().fold([f64::MAX, f64::MIN], |[a, b], (at, _)| [a.min(*at), b.max(*at)]);
    let mut chart = Chart::new(ends, [least.max(most - 80.0), most], [page.unit, "dB"]);
    for number in 0..first.len() {
        let points = page.eigenvalues.iter().step_by(step);
        let points = points.filter_map(|(at, values)| Some([*at, db(*values.get(number)?)]));
        chart.path(points, COLOURS[number % COLOURS.len()]);
    }
    html.push_str(&chart.end());
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_page_asks_nobody_for_anything_and_a_title_is_no_markup() {
        let points = vec![
            Point { at: 0.0, emitter: 1, azimuth_deg: 10.0, sigma_deg: 4.0, is_valid: true, is_flagged: false },
            Point { at: 1.0, emitter: 2, azimuth_deg: -10.0, sigma_deg: 4.0, is_valid: false, is_flagged: true },
        ];
        let shown = Page {
            title: "<script>".to_owned(),
            unit: "frame",
            answers: 3,
            points,
            eigenvalues: vec![(0.0, vec![4.0, 1.0]), (1.0, vec![4.0, 0.0])],
            spectrum: vec![[-1.0, -30.0], [1.0, 0.0]],
            band_hz: Some([-0.5, 0.5]),
            ..Page::default()
        };
        let html = page(&shown);
        assert!(!html.contains("<script") && !html.contains("http") && !html.contains("src="));
        assert!(html.contains("3 answers: 1 valid, 1 without a direction, 1 flagged"));
        assert_eq!(
            (html.matches("<svg").count(), html.matches("<circle").count(), html.matches("<polyline").count()),
            (3, 2, 3)
        );
        assert!(!html.contains("NaN") && !html.contains("inf"));
        assert!(page(&Page::default()).contains("None."));
    }
}
