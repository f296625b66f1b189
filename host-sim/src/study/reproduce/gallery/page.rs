//! The index page: nothing in it is fetched but the figures beside it.

use std::fmt::Write as _;

use super::{REPORT, Shown, TABLE};
use crate::record::listening::text;
use crate::study::reproduce::{Beside, Judgement};
use crate::study::reproduce::{Experiment, PAPERS, Settings};

const STYLE: &str = include_str!("page.css");

/// The page of these experiments.
pub(super) fn page(all: &[Shown], settings: &Settings, command: &str) -> String {
    let mut html = String::from("<!doctype html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n");
    html.push_str("<meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n");
    // No address, from which a browser would ask for an icon.
    html.push_str("<link rel=\"icon\" href=\"data:,\">\n<title>Foxhound: the papers, reproduced</title>\n");
    let _ = writeln!(html, "<style>\n{STYLE}</style>\n</head>\n<body>\n<header>\n<h1>The papers, reproduced</h1>");
    let seconds: f64 = all.iter().map(|shown| shown.seconds).sum();
    let _ = writeln!(
        html,
        "<p>Foxhound {}, seed {}: {} pairs a map, {} scenes of a kind, {} trials a condition, {} scenarios. The experiments \
         took {} in all.</p>\n<p>Again: <code>{}</code></p>\n</header>\n<main>",
        env!("CARGO_PKG_VERSION"),
        settings.seed,
        settings.pairs,
        settings.scenes,
        settings.trials,
        settings.scenarios,
        duration(seconds),
        text(command)
    );
    html.push_str("<nav aria-label=\"experiments\"><ul>\n");
    for experiment in experiments(all) {
        let _ = writeln!(html, "<li><a href=\"#{}\">{}</a></li>", experiment.name, text(experiment.title));
    }
    html.push_str("</ul></nav>\n");
    verdicts(&mut html, &all.iter().flat_map(|shown| &shown.made.judgements).collect::<Vec<_>>());
    html.push_str("<section id=\"published\">\n<h2>What was published, and ours</h2>\n");
    html.push_str(
        "<p>Published: the number that the paper prints, empty where it prints none. Its method here: the published method \
         in this program, under the conditions of this program. What was left open, and how it was read, stands with each \
         experiment.</p>\n",
    );
    let lines: Vec<&Beside> = all.iter().flat_map(|shown| &shown.made.beside).collect();
    comparison(&mut html, &lines, true);
    html.push_str("</section>\n");
    for (shown, experiment) in all.iter().zip(experiments(all)) {
        section(&mut html, shown, experiment);
    }
    citations(&mut html);
    html.push_str("</main>\n</body>\n</html>\n");
    html
}

/// Which experiments these are.
fn experiments(all: &[Shown]) -> impl Iterator<Item = Experiment> {
    all.iter().filter_map(|shown| Experiment::named(shown.experiment))
}

fn section(html: &mut String, shown: &Shown, experiment: Experiment) {
    let name = experiment.name;
    let _ = writeln!(
        html,
        "<section id=\"{name}\">\n<h2>{}</h2>\n<p class=\"source\">{}. <code>foxhound reproduce {name}</code>, {}.</p>",
        text(experiment.title),
        text(experiment.source),
        duration(shown.seconds)
    );
    let _ = writeln!(html, "<p>{}</p>", text(experiment.note));
    comparison(html, &shown.made.beside.iter().collect::<Vec<_>>(), false);
    for picture in shown.made.files.iter().filter(|name| name.ends_with(".svg")) {
        let (file, title) = (format!("{name}/{picture}"), picture.trim_end_matches(".svg"));
        let _ = writeln!(
            html,
            "<figure><a href=\"{0}\"><img loading=\"lazy\" src=\"{0}\" alt=\"Figure {1}\"></a><figcaption>{1}</figcaption></figure>",
            text(&file),
            text(title)
        );
    }
    let _ = writeln!(
        html,
        "<details><summary>All numbers</summary>\n<pre tabindex=\"0\">{}</pre>\n</details>\n\
         <p class=\"files\"><a href=\"{name}/{TABLE}\">{TABLE}</a> <a href=\"{name}/{REPORT}\">{REPORT}</a></p>\n</section>",
        text(&shown.table)
    );
}

fn comparison(html: &mut String, lines: &[&Beside], names: bool) {
    html.push_str("<div class=\"wide\" tabindex=\"0\"><table>\n<thead><tr>");
    let heads = ["experiment", "what", "published", "its method here", "Foxhound"];
    for head in &heads[usize::from(!names)..] {
        let _ = write!(html, "<th scope=\"col\">{head}</th>");
    }
    html.push_str("</tr></thead>\n<tbody>\n");
    let mut last = "";
    for line in lines {
        html.push_str("<tr>");
        if names {
            let name = if line.experiment == last { "" } else { &line.experiment };
            let _ = write!(html, "<td><a href=\"#{}\">{}</a></td>", text(&line.experiment), text(name));
            last = &line.experiment;
        }
        let _ = write!(html, "<th scope=\"row\">{}</th>", text(&line.what));
        for words in [&line.published, &line.theirs, &line.ours] {
            let _ = write!(html, "<td>{}</td>", text(words));
        }
        html.push_str("</tr>\n");
    }
    html.push_str("</tbody></table></div>\n");
}

/// Verdict for each figure.
fn verdicts(html: &mut String, judgements: &[&Judgement]) {
    html.push_str(
        "<section id=\"verdicts\">\n<h2>Figure by figure</h2>\n<p>Reproduced: the published method gives the published result \
         here. Better: it does not, and Foxhound's result is at least as good as the published one.</p>\n<div class=\"wide\" \
         tabindex=\"0\"><table>\n<thead><tr><th scope=\"col\">figure</th><th scope=\"col\">verdict</th><th \
         scope=\"col\">why</th></tr></thead>\n<tbody>\n",
    );
    for Judgement { experiment, figure, verdict, why } in judgements {
        let _ = writeln!(
            html,
            "<tr><th scope=\"row\"><a href=\"#{}\">{}</a></th><td>{}</td><td>{}</td></tr>",
            text(experiment),
            text(figure),
            verdict.words(),
            text(why)
        );
    }
    html.push_str("</tbody></table></div>\n</section>\n");
}

/// The papers, in full.
fn citations(html: &mut String) {
    html.push_str("<section id=\"papers\">\n<h2>The papers</h2>\n<dl>\n");
    for (name, citation) in PAPERS {
        let _ = writeln!(html, "<dt>{}</dt><dd>{}</dd>", text(name), text(citation));
    }
    html.push_str("</dl>\n</section>\n");
}

/// `1 min 20 s`.
fn duration(seconds: f64) -> String {
    if seconds < 60.0 {
        return format!("{seconds:.1} s");
    }
    let whole = libm::rint(seconds) as u64;
    format!("{} min {:02} s", whole / 60, whole % 60)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn markup_in_a_text_is_no_markup_and_minutes_are_not_rounded_to_sixty_seconds() {
        assert_eq!(text("<a href=\"x\">&"), "&lt;a href=&quot;x&quot;&gt;&amp;");
        assert_eq!([59.94, 60.0, 119.6].map(duration), ["59.9 s", "1 min 00 s", "2 min 00 s"]);
    }
}
