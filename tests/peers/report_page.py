"""Opens a flight's report in Chromium and uses it, with mouse and keys, on a desk and on a phone.

Usage: report_page.py FLIGHT.html
       report_page.py FLIGHT.html --briefly
       report_page.py FLIGHT.html --screenshot PICTURE.png

The second leaves out the controls and looks, which are the same for every flight. The third makes the picture of the manual:
    cargo run --release -- fly --report out/flight.html
    target/venv/bin/python tests/peers/report_page.py out/flight.html --screenshot docs/report.png
"""

import os
import pathlib
import sys

import cv2
import numpy
from playwright.sync_api import sync_playwright

from checks import check, chromium, settle, watch
from report_records import records_of

DESK = {"width": 1440, "height": 900}
PHONES = ({"width": 360, "height": 740}, {"width": 320, "height": 568})
# WebGL without a graphics card; the rest of the page is drawn without it, in half the time.
FLAGS = ("--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--ignore-gpu-blocklist", "--disable-gpu-compositing")
# Of the driver: copying the 3-D view into such a page takes time.
SLOW = "GPU stall due to ReadPixels"
# What an eye tells apart side by side, in units of CIE Lab, is 2 to 3.
APART = 10
# Machado, Oliveira and Fernandes (2009), severity 1: linear red, green and blue as the two commonest colour-blind see them.
BLIND = {
    "protanopia": ((0.152286, 1.052583, -0.204868), (0.114503, 0.786281, 0.099216), (-0.003882, -0.048116, 1.051998)),
    "deuteranopia": ((0.367322, 0.860646, -0.227968), (0.280085, 0.672501, 0.047413), (-0.011820, 0.042940, 0.968881)),
}

path = pathlib.Path(sys.argv[1]).resolve()
records = records_of(path.read_text())
# As they came: the header, by time, the end.
records = records[:1] + sorted(records[1:-1], key=lambda record: record.get("time_s", 1e9)) + records[-1:]
steps = [record for record in records if record["kind"] == "step"]
plans = [record for record in records if record["kind"] == "plan"]
signals = [record for record in records if record["kind"] == "signal"]
pictures = [record for record in records if record["kind"] == "picture"]
thinned = [record for record in records if record["kind"] == "thinned"]
begin, end = records[0], records[-1]
troubles, requests = [], []


def opened(browser, address="", **options):
    """The page in a browser without network, which tells of every complaint and every request."""
    context = browser.new_context(offline=True, **options)
    page = context.new_page()
    watch(page, troubles, requests, harmless=SLOW)
    page.on("dialog", lambda dialog: (troubles.append("dialog: " + dialog.message), dialog.dismiss()))
    page.goto(path.as_uri() + address)
    page.wait_for_selector("#map[data-step]")
    return page


def at(page):
    """The step that is shown."""
    settle(page)
    return int(page.locator("#map").get_attribute("data-step"))


def at_time(time_s):
    """The last step that is not later."""
    return max(index for index, step in enumerate(steps) if step["time_s"] <= time_s + 1e-9)


def shows(page, index):
    """Whether the vehicle is where it was at a step, in the data and in the words."""
    shown = at(page)
    place = [float(page.locator("#map").get_attribute(f"data-{axis}")) for axis in "xy"]
    told = page.locator("#clock").inner_text()
    return shown == index and place == steps[index]["place_m"] and told.startswith(f"{steps[index]['time_s']:.2f} ")


def pixels(page, canvas):
    settle(page)
    return page.evaluate(f"document.getElementById('{canvas}').toDataURL()")


def use_slider(page):
    slider = page.locator("#time")
    check(shows(page, len(steps) - 1), "it opens at the end of the flight")
    before = pixels(page, "map")
    box = slider.bounding_box()
    for share in (0.25, 0.7):
        page.mouse.click(box["x"] + share * box["width"], box["y"] + box["height"] / 2)
        index = at(page)
        check(abs(index / len(steps) - share) < 0.03, f"a press on the slider at {share} leads to step {index}")
        check(shows(page, index), "the vehicle is where it was then")
    check(pixels(page, "map") != before, "the map is another one")
    value = slider.get_attribute("aria-valuetext")
    check(value.startswith(f"{steps[index]['time_s']:.2f} s, "), f"the slider says `{value}`")
    page.locator(".chart canvas").first.click()
    check(0.4 < at(page) / len(steps) < 0.6, "a press on a chart leads to its time")


def use_keys(page):
    page.locator("h1").click()
    press = page.keyboard.press
    press("Home")
    check(shows(page, 0), "Home is the beginning")
    press("ArrowRight")
    press("ArrowRight")
    check(shows(page, 2), "an arrow is a step")
    press("Shift+ArrowRight")
    second = at_time(steps[2]["time_s"] + 1)
    check(shows(page, second), "with Shift a second")
    press("ArrowLeft")
    check(shows(page, second - 1), "and back")
    after = [plan for plan in plans if plan["time_s"] > steps[second - 1]["time_s"] + 1e-6]
    if after:
        press(".")
        check(at(page) == at_time(after[0]["time_s"]), "a full stop is the next replan")
    press("End")
    check(shows(page, len(steps) - 1), "End is the end")
    page.locator("#time").focus()
    press("Home")
    check(shows(page, 0), "on the slider as well")
    press("ArrowRight")
    check(shows(page, 1), "a step there too, and not two")
    press("Space")
    # A busy machine draws few pictures.
    for _ in range(100):
        page.wait_for_timeout(300)
        if at(page) > 5:
            break
    press("Space")
    index = at(page)
    check(5 < index < len(steps) - 1, f"Space plays: step {index}")
    page.wait_for_timeout(300)
    check(at(page) == index, "and Space pauses")


def use_potential(page):
    page.evaluate("location.hash = '#t=6'")
    page.locator("#tab-field").click()
    settle(page)
    index, first = at(page), pixels(page, "field")
    is_drawn(page, "field", "the potential")
    shown = [plan for plan in plans if plan["time_s"] <= steps[index]["time_s"] + 1e-6 and "thinned" not in plan][-1]
    page.locator("#field-mean").press("Enter")
    check(page.locator("#field-mean").get_attribute("aria-pressed") == "true", "the mean gains can be chosen by key")
    same = shown["gains"] == begin["gains"]
    check((pixels(page, "field") != first) != same, "with them it is another picture")
    rows = page.locator("#samples tbody tr").count()
    check(rows == len(shown["samples"]), f"{rows} trajectories with their costs")
    check(page.locator("#samples tr.best").count() == ("chosen" in shown), "the one that is followed stands out")


def use_map(page):
    canvas, first = page.locator("#map"), pixels(page, "map")
    canvas.focus()
    page.keyboard.press("+")
    nearer = pixels(page, "map")
    check(nearer != first, "plus zooms")
    page.keyboard.press("0")
    check(pixels(page, "map") == first, "0 fits it again")
    if thinned:
        # On the map of a long flight the vehicle is smaller than a pixel.
        page.locator("#zoom-follow").click()
    for box in page.locator("#layers input").all():
        before = pixels(page, "map")
        box.focus()
        page.keyboard.press("Space")
        name = box.get_attribute("name")
        # Where nobody moves nothing is followed.
        drawn = name != "tracks" and (
            name not in ("heard", "samples", "remembered", "belief") or end["report"]["result"] == "reached"
        )
        check(pixels(page, "map") != before or not drawn, f"the layer `{name}` can be switched by key")
        page.keyboard.press("Space")


def is_named(page):
    page.locator("#tab-field").click()
    nameless = page.evaluate("""() => [...document.querySelectorAll('button, input, select, canvas[role], summary, [tabindex]')]
        .filter((e) => !(e.getAttribute('aria-label') || e.getAttribute('aria-labelledby') || (e.labels && e.labels.length) || e.textContent.trim()))
        .map((e) => e.outerHTML)""")
    check(not nameless, f"everything that takes the focus has a name {nameless}")
    page.locator(".skip").focus()
    seen = set()
    for _ in range(60):
        seen.add(page.evaluate("document.activeElement.id"))
        page.keyboard.press("Tab")
    wanted = {"path-by", "tab-map", "map", "tab-field", "play", "time", "rate", "copy"}
    check(wanted <= seen, f"Tab comes by {sorted(wanted)} {sorted(wanted - seen)}")


def use_events(page):
    lines = page.locator("#events button")
    page.keyboard.press("Home")
    lines.first.focus()
    for _ in range(3):
        page.keyboard.press("ArrowDown")
    time = float(lines.nth(3).locator("time").inner_text().split()[0])
    check(abs(steps[at(page)]["time_s"] - time) < 0.011, f"three lines down is at {time} s")
    lines.last.click()
    check(shows(page, len(steps) - 1), "the last line is the end")


def holds_what_was_flown(page):
    check(page.locator("#name").inner_text() == " ".join(begin["scenario"]["name"].split()), "the name, as text")
    check(page.evaluate("document.images.length") == 0, "no markup out of the records")
    run = page.locator("#run").inner_text()
    check(end["report"]["trace_hash"] in run and f"{end['steps']} of 20 ms" in run, "trace hash and number of steps")
    note = page.locator("#thinned")
    check(note.is_visible() == bool(thinned), "what was left out is said where something was")
    for row in thinned[0]["what"] if thinned else []:
        check(f"{row['kept']} of {row['all']} {row['what']}" in note.inner_text(), f"of the {row['what']}")
    held = page.evaluate("({steps: flight.steps, plans: flight.plans.map(({field, ...rest}) => rest), signals: flight.signals, pictures: flight.pictures})")
    bare = [{key: value for key, value in plan.items() if key != "field"} for plan in plans]
    for kind, ours in (("steps", steps), ("plans", bare), ("signals", signals), ("pictures", pictures)):
        check(held[kind] == ours, f"the page has unpacked the same {len(ours)} {kind}")
    check(page.locator("#command").inner_text() == begin["command"], "the command that made it")
    check(page.locator("#parameters tbody tr").count() == len(begin["parameters"]), "all parameters")
    one = page.evaluate("[...document.querySelectorAll('canvas')].filter((c) => !c.width || !c.height).length")
    check(one == 0, "every picture has a size")


def takes_records_one_by_one(page):
    """As they arrive from a flight under way."""
    half = records[: len(records) // 2]
    flown = sum(record["kind"] == "step" for record in half)
    page.evaluate("(records) => records.forEach((record) => add(record))", half)
    settle(page)
    check(page.locator("#verdict").inner_text() == "under way", "a header begins a new flight, which is under way")
    # A list that has the focus takes the key for itself.
    page.evaluate("document.activeElement.blur()")
    page.keyboard.press("End")
    check(shows(page, flown - 1), "the steps so far")
    page.evaluate("(records) => records.forEach((record) => add(record))", records[len(half) :])
    check(shows(page, len(steps) - 1), "at the end it follows what comes")
    check(page.locator("#verdict").inner_text().startswith(end["report"]["result"]), "until it has ended")


def fits(page, width):
    wide = page.evaluate("Math.max(document.documentElement.scrollWidth, document.body.scrollWidth)")
    check(wide <= width, f"no scrolling sideways: {wide} of {width}")
    page.evaluate("scrollTo(0, document.body.scrollHeight)")
    player = page.locator(".player").bounding_box()
    check(player["y"] + player["height"] <= page.viewport_size["height"] + 1, "the replay stays at hand")
    if width == DESK["width"]:
        return
    small = page.evaluate("""() => [...document.querySelectorAll('button, select')].filter((e) => e.offsetParent && e.offsetHeight < 24)
        .map((e) => e.id || e.textContent)""")
    check(not small, f"everything is large enough for a finger {small}")


def shot(page, canvas):
    """The pixels of a canvas, as somebody sees them."""
    settle(page)
    return cv2.imdecode(numpy.frombuffer(page.locator(f"#{canvas}").screenshot(), numpy.uint8), cv2.IMREAD_COLOR)


def is_drawn(page, canvas, text):
    kinds = len(numpy.unique(shot(page, canvas).reshape(-1, 3), axis=0))
    check(kinds > 8, f"drawn, in {kinds} colours: {text}")


def use_tabs(page):
    page.locator("#tab-map").focus()
    page.keyboard.press("ArrowRight")
    check(page.evaluate("document.activeElement.id") == "tab-space", "an arrow leads from tab to tab")
    check(page.locator("#space").is_visible() and not page.locator("#map").is_visible(), "and brings its pane to the front")
    page.locator("h1").click()
    for key, canvas in (("s", "spectrum"), ("v", "section"), ("p", "field"), ("m", "map"), ("3", "space")):
        page.keyboard.press(key)
        check(page.locator(f"#{canvas}").is_visible(), f"`{key}` shows the {canvas}")


def use_space(page):
    page.locator("#tab-space").click()
    is_drawn(page, "space", "the view in space")
    canvas = page.locator("#space")
    label = canvas.get_attribute("aria-label")
    check(f"{steps[at(page)]['height_m']:.2f} metres high" in label, f"it says `{label}`")
    for act, text in (
        (lambda: canvas.press("ArrowLeft"), "an arrow turns it"),
        (lambda: canvas.press("+"), "plus zooms"),
        (lambda: canvas.press("r"), "R rides along"),
        (lambda: page.locator("#space-follow").click(), "it follows"),
        (lambda: canvas.press("0"), "0 shows all"),
    ):
        before, index = shot(page, "space"), at(page)
        act()
        check((shot(page, "space") != before).any() and at(page) == index, f"in space {text}, and the time stays")
    box, before = canvas.bounding_box(), shot(page, "space")
    page.mouse.move(box["x"] + 100, box["y"] + 100)
    page.mouse.down()
    page.mouse.move(box["x"] + 200, box["y"] + 130, steps=4)
    page.mouse.up()
    dragged = shot(page, "space")
    check((dragged != before).any(), "a drag turns it")
    page.mouse.wheel(0, -300)
    check((shot(page, "space") != dragged).any(), "the wheel zooms")
    before = shot(page, "space")
    page.locator("h1").click()
    page.keyboard.press("Home")
    check((shot(page, "space") != before).any(), "another time is another picture")
    page.locator("#tab-map").click()


def use_signal(page):
    page.locator("#tab-signal").click()
    page.evaluate("location.hash = '#t=1'")
    settle(page)
    said = page.locator("#signal-words").inner_text()
    if not signals:
        check("no waveforms" in said, f"without waveforms it says `{said}`")
        return
    signal = [one for one in signals if one["time_s"] <= steps[at(page)]["time_s"] + 1e-6][-1]
    loudest = max(range(64), key=lambda bin: signal["spectrum_db"][bin])
    is_drawn(page, "spectrum", "the spectrum")
    label = page.locator("#spectrum").get_attribute("aria-label")
    check(f"loudest at {(loudest + 0.5) * begin['bin_hz'] / 1000:.1f} kHz" in label, f"it says `{label}`")
    if "tone" in signal:
        is_drawn(page, "phases", "the phases")
        check(all(f"{deg:.1f} deg" in said for deg in signal["tone"]["phases_deg"]), f"the phases are those recorded: `{said}`")


def use_section(page):
    page.locator("#tab-section").click()
    is_drawn(page, "section", "the vertical section")
    canvas = page.locator("#section")
    box = canvas.bounding_box()
    page.mouse.click(box["x"] + 0.5 * box["width"], box["y"] + box["height"] / 2)
    index = at(page)
    check(float(canvas.get_attribute("data-height")) == steps[index]["height_m"], f"it shows the height at step {index}")
    page.locator("h1").click()
    page.keyboard.press("End")
    at(page)
    said = page.locator("#section-words").inner_text()
    stage = steps[-1].get("landing", {}).get("stage", "")
    check(said.startswith(f"{steps[-1]['height_m']:.2f} m high") and stage.replace("_", " ") in said, f"at the end it says `{said}`")
    check(page.locator("#camera-panel").is_visible() == bool(pictures), "there is a camera where there are pictures")
    if not pictures:
        return
    page.wait_for_selector("#camera[data-time]")
    is_drawn(page, "camera", "the picture of the camera")
    page.locator("#picture-before").click()
    at(page)
    check(f"{len(pictures) - 1} of {len(pictures)}" in page.locator("#camera-words").inner_text(), "the picture before can be chosen")


def use_bands(page):
    """The guard's actions and the outcomes over time, with their reasons in words."""
    acts = [index for index, step in enumerate(steps) if "guard_reason" in step]
    if not acts:
        return
    page.evaluate("(time_s) => seek(time_s)", steps[acts[len(acts) // 2]]["time_s"])
    step = steps[at(page)]
    text = f"{step['guard']}: {step['guard_reason']}"
    check(text in page.locator("#charts").inner_text(), f"the band says `{text}`")
    check(step["guard_reason"] in page.locator("#now").inner_text(), "and so do the numbers of the moment")
    # It waits until the cursor stands.
    for _ in range(300):
        told = page.locator("#told").inner_text()
        if step["guard_reason"] in told:
            break
        page.wait_for_timeout(100)
    check(step["guard_reason"] in told and f"{step['height_m']:.1f} metres high" in told, f"a screen reader is told `{told}`")


def has_names(page):
    """What a screen reader finds: the roles with their names."""
    tree = page.locator("body").aria_snapshot()
    for wanted in ('tab "Map" [selected]', 'tab "3-D"', 'tab "Section"', 'slider "Time of the flight"', 'button "Play"', 'img "Map. ', 'status', 'combobox "Speed of the replay"'):
        check(wanted in tree, f"a screen reader finds {wanted}")


def is_fluent(page):
    """Prints times; what takes them is bounded by what is drawn, which does not grow with the flight."""
    first = page.evaluate("Number(document.documentElement.dataset.firstPicture)")
    times = page.evaluate("""() => [0.1, 0.3, 0.5, 0.7, 0.9].map((share) => {
        const since = performance.now();
        replay.index = Math.round(share * (flight.steps.length - 1));
        wanted = { all: false };
        draw();
        return performance.now() - since;
    })""")
    page.evaluate("goTo(flight.steps.length)")
    print(f"{steps[-1]['time_s']:.0f} s of flight, {path.stat().st_size} bytes: first picture after {first:.0f} ms, the next in {max(times):.0f} ms at most")
    check(page.locator("#events button").count() <= 1000, "the list of what happened stays short")
    drawn = page.evaluate("CHARTS.flatMap((chart) => chart.series.filter((s) => s.kind === 'line').map((s) => perPixel(s.points(), chart.x).length))")
    check(max(drawn) <= 4 * DESK["width"], f"no line of a chart has more points than pixels show: {max(drawn)}")


def linear(color):
    channels = [int(color[k : k + 2], 16) / 255 for k in (1, 3, 5)]
    return [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in channels]


def luminance(color):
    return sum(weight * c for weight, c in zip((0.2126, 0.7152, 0.0722), linear(color)))


def lab(rgb):
    rows = ((0.4124, 0.3576, 0.1805), (0.2126, 0.7152, 0.0722), (0.0193, 0.1192, 0.9505))
    white = (0.9505, 1.0, 1.089)
    x, y, z = (sum(a * max(c, 0) for a, c in zip(row, rgb)) / w for row, w in zip(rows, white))
    f = [t ** (1 / 3) if t > 0.008856 else 7.787 * t + 16 / 116 for t in (x, y, z)]
    return 116 * f[1] - 16, 500 * (f[0] - f[1]), 200 * (f[1] - f[2])


def luma(color):
    return [int(part) for part in color[4:-1].split(",")]


def is_legible(page, theme):
    check(page.evaluate("getComputedStyle(document.documentElement).colorScheme") == theme, f"it is {theme} where the system is")
    colors = page.evaluate("readColors(), colors")
    for name in ("ink", "faint", "green", "red", "orange"):
        bright, dim = sorted((luminance(colors[name]), luminance(colors["panel"])), reverse=True)
        ratio = (bright + 0.05) / (dim + 0.05)
        least = 4.5 if name in ("ink", "faint", "green", "red") else 3
        check(ratio >= least, f"{theme}: {name} on its ground has a contrast of {ratio:.1f}")
    told = ("green", "orange", "red", "blue", "purple")
    for kind, matrix in BLIND.items():
        seen = {name: lab([sum(a * c for a, c in zip(row, linear(colors[name]))) for row in matrix]) for name in told}
        pairs = [(a, b) for a in told for b in told if a < b]
        apart = {pair: sum((x - y) ** 2 for x, y in zip(seen[pair[0]], seen[pair[1]])) ** 0.5 for pair in pairs}
        nearest = min(apart, key=apart.get)
        check(apart[nearest] > APART, f"{theme}, {kind}: the nearest colours, {nearest}, are {apart[nearest]:.0f} apart")


def use(browser, is_brief):
    page = opened(browser, viewport=DESK)
    is_fluent(page)
    if begin["scenario"].get("landing"):
        check(page.locator("#section").is_visible(), "with a landing it opens with the section")
    holds_what_was_flown(page)
    use_signal(page)
    use_section(page)
    use_bands(page)
    use_events(page)
    fits(page, DESK["width"])
    if not is_brief:
        use_controls(opened(browser, viewport=DESK))
        looks_as_it_should(page)
        takes_records_one_by_one(page)
        for size in PHONES:
            use_phone(browser, size)
        plays_calmly(browser)
    check(not troubles, f"no error on the console {troubles}")
    others = [url for url in requests if url != path.as_uri() and not url.startswith("data:")]
    others = [url for url in others if not url.startswith(path.as_uri() + "#")]
    check(not others, f"no request but the page {others}")


def use_controls(page):
    has_names(page)
    use_slider(page)
    use_keys(page)
    use_potential(page)
    use_map(page)
    use_tabs(page)
    use_space(page)
    is_named(page)


def looks_as_it_should(page):
    is_legible(page, "light")
    light = page.evaluate("getComputedStyle(document.body).backgroundColor")
    page.emulate_media(color_scheme="dark")
    is_legible(page, "dark")
    dark = page.evaluate("getComputedStyle(document.body).backgroundColor")
    check(sum(luma(dark)) < 0.3 * sum(luma(light)), f"the ground goes from {light} to {dark}")


def use_phone(browser, size):
    phone = opened(browser, viewport=size, device_scale_factor=2, is_mobile=True, has_touch=True, color_scheme="dark")
    is_legible(phone, "dark")
    fits(phone, size["width"])
    for tab in ("space", "signal", "section", "map", "field"):
        phone.evaluate(f"showTab('{tab}')")
        settle(phone)
        fits(phone, size["width"])
    phone.locator("#play").tap()
    for _ in range(100):
        phone.wait_for_timeout(300)
        if at(phone) > 0:
            break
    phone.locator("#play").tap()
    check(0 < at(phone) < len(steps) - 1, "a tap plays")


def plays_calmly(browser):
    still = opened(browser, viewport=DESK, reduced_motion="reduce")
    # A second; where the machine is busy, until a second picture is shown.
    seen, took_s = still.evaluate("""async () => {
        const seen = new Set();
        goTo(0);
        play(true);
        const since = performance.now();
        const took_s = () => (performance.now() - since) / 1000;
        while (took_s() < 1 || (seen.size < 2 && took_s() < 10)) {
            seen.add(replay.index);
            await new Promise(requestAnimationFrame);
        }
        play(false);
        return [seen.size, took_s()];
    }""")
    check(2 <= seen <= 6 * took_s, f"where little motion is wanted playing shows {seen} pictures in {took_s:.1f} s")


def picture(browser, target):
    page = opened(browser, "#t=7.6", viewport={"width": 1280, "height": 880})
    page.locator("#tab-space").click()
    page.locator("#space").press("+")
    page.locator("#space").press("+")
    page.locator("#tab-signal").click()
    page.locator("h1").click()
    settle(page)
    page.screenshot(path=target)
    size = os.path.getsize(target)
    check(size <= 300_000, f"{target}: {size} bytes")


with sync_playwright() as play:
    browser = chromium(play, *FLAGS)
    if "--screenshot" in sys.argv:
        picture(browser, sys.argv[3])
    else:
        use(browser, "--briefly" in sys.argv)
        print("all checks passed")
    browser.close()
