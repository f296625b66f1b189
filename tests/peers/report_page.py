"""Opens a flight's report in Chromium and uses it, with mouse and keys, on a desk and on a phone.

Usage: report_page.py FLIGHT.html
       report_page.py FLIGHT.html --screenshot PICTURE.png

The second makes the picture of the manual:
    cargo run --release -- fly --report out/flight.html
    target/venv/bin/python tests/peers/report_page.py out/flight.html --screenshot docs/report.png
"""

import json
import os
import pathlib
import re
import shutil
import sys

from playwright.sync_api import sync_playwright

BROWSERS = ("chromium", "chromium-browser", "google-chrome")
DESK = {"width": 1440, "height": 900}
PHONES = ({"width": 390, "height": 844}, {"width": 320, "height": 568})
# What an eye tells apart side by side, in units of CIE Lab, is 2 to 3.
APART = 10
# Machado, Oliveira and Fernandes (2009), severity 1: linear red, green and blue as the two commonest colour-blind see them.
BLIND = {
    "protanopia": ((0.152286, 1.052583, -0.204868), (0.114503, 0.786281, 0.099216), (-0.003882, -0.048116, 1.051998)),
    "deuteranopia": ((0.367322, 0.860646, -0.227968), (0.280085, 0.672501, 0.047413), (-0.011820, 0.042940, 0.968881)),
}

path = pathlib.Path(sys.argv[1]).resolve()
records = json.loads(re.search(r'id="records">(.*?)</script>', path.read_text(), re.S).group(1))
steps = [record for record in records if record["kind"] == "step"]
plans = [record for record in records if record["kind"] == "plan"]
begin, end = records[0], records[-1]
troubles, requests = [], []


def check(condition, text):
    if not condition:
        print("FAILED:", text)
        sys.exit(1)
    print("ok:", text)


def opened(browser, address="", **options):
    """The page in a browser without network, which tells of every complaint and every request."""
    context = browser.new_context(offline=True, **options)
    page = context.new_page()
    page.on("console", lambda message: troubles.append(message.text) if message.type in ("error", "warning") else None)
    page.on("pageerror", lambda error: troubles.append(str(error)))
    page.on("dialog", lambda dialog: (troubles.append("dialog: " + dialog.message), dialog.dismiss()))
    page.on("request", lambda request: requests.append(request.url))
    page.goto(path.as_uri() + address)
    page.wait_for_selector("#map[data-step]")
    return page


def settle(page):
    """Until what was done is drawn: the picture after the next."""
    page.wait_for_timeout(30)
    page.evaluate("new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(() => requestAnimationFrame(done))))")


def at(page):
    """The step that is shown."""
    settle(page)
    return int(page.locator("#map").get_attribute("data-step"))


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
    check(shows(page, 52), "with Shift a second")
    press("ArrowLeft")
    check(shows(page, 51), "and back")
    after = [plan for plan in plans if plan["time_s"] > steps[51]["time_s"] + 1e-6]
    if after:
        press(".")
        check(abs(steps[at(page)]["time_s"] - after[0]["time_s"]) < 1e-6, "a full stop is the next replan")
    press("End")
    check(shows(page, len(steps) - 1), "End is the end")
    page.locator("#time").focus()
    press("Home")
    check(shows(page, 0), "on the slider as well")
    press("ArrowRight")
    check(shows(page, 1), "a step there too, and not two")
    press("Space")
    page.wait_for_timeout(600)
    press("Space")
    index = at(page)
    check(5 < index < len(steps) - 1, f"Space plays: step {index} after 0.6 s and some")
    page.wait_for_timeout(300)
    check(at(page) == index, "and Space pauses")


def use_potential(page):
    page.evaluate("location.hash = '#t=6'")
    settle(page)
    canvas, index, first = page.locator("#field"), at(page), pixels(page, "field")
    shown = [plan for plan in plans if plan["time_s"] <= steps[index]["time_s"] + 1e-6][-1]
    canvas.focus()
    page.keyboard.press("ArrowLeft")
    page.keyboard.press("ArrowUp")
    turned = pixels(page, "field")
    check(turned != first and at(page) == index, "arrows turn the surface, and not the time")
    box = canvas.bounding_box()
    page.mouse.move(box["x"] + 100, box["y"] + 100)
    page.mouse.down()
    page.mouse.move(box["x"] + 180, box["y"] + 120, steps=4)
    page.mouse.up()
    dragged = pixels(page, "field")
    check(dragged != turned, "a drag turns it")
    page.locator("#field-mean").press("Enter")
    mean = pixels(page, "field")
    same = shown["gains"] == begin["gains"]
    check((mean != dragged) != same, "with the mean gains it is another surface")
    dragged = mean
    page.locator("#field-heat").press("Enter")
    check(page.locator("#field-heat").get_attribute("aria-pressed") == "true", "the heat map can be chosen by key")
    check(pixels(page, "field") != dragged, "and is another picture")
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
    nameless = page.evaluate("""() => [...document.querySelectorAll('button, input, select, canvas[role], summary, [tabindex]')]
        .filter((e) => !(e.getAttribute('aria-label') || e.getAttribute('aria-labelledby') || (e.labels && e.labels.length) || e.textContent.trim()))
        .map((e) => e.outerHTML)""")
    check(not nameless, f"everything that takes the focus has a name {nameless}")
    page.locator(".skip").focus()
    seen = set()
    for _ in range(60):
        seen.add(page.evaluate("document.activeElement.id"))
        page.keyboard.press("Tab")
    wanted = {"path-by", "map", "field", "play", "time", "rate", "copy", "theme"}
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
    check(end["report"]["trace_hash"] in run and f"{len(steps)} of 20 ms" in run, "trace hash and number of steps")
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


def is_legible(page, theme):
    check(page.locator("html").get_attribute("data-theme") == theme, f"it is {theme} where the system is")
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


def use(browser):
    page = opened(browser, viewport=DESK)
    use_slider(page)
    use_keys(page)
    holds_what_was_flown(page)
    use_potential(page)
    use_map(page)
    use_events(page)
    is_named(page)
    is_legible(page, "light")
    fits(page, DESK["width"])
    page.locator("#theme").click()
    is_legible(page, "dark")
    takes_records_one_by_one(page)
    for size in PHONES:
        phone = opened(browser, viewport=size, device_scale_factor=2, is_mobile=True, has_touch=True, color_scheme="dark")
        is_legible(phone, "dark")
        fits(phone, size["width"])
        phone.locator("#play").tap()
        phone.wait_for_timeout(400)
        phone.locator("#play").tap()
        check(0 < at(phone) < len(steps) - 1, "a tap plays")
    check(not troubles, f"no error on the console {troubles}")
    others = [url for url in requests if url != path.as_uri() and not url.startswith("data:")]
    others = [url for url in others if not url.startswith(path.as_uri() + "#")]
    check(not others, f"no request but the page {others}")


def picture(browser, target):
    page = opened(browser, "#t=7.6", viewport={"width": 1280, "height": 880})
    settle(page)
    page.screenshot(path=target)
    size = os.path.getsize(target)
    check(size <= 300_000, f"{target}: {size} bytes")


with sync_playwright() as play:
    program = next(filter(None, map(shutil.which, BROWSERS)), None)
    check(program, "there is a Chromium")
    # Its sandbox does not work for root; nothing foreign is opened.
    browser = play.chromium.launch(executable_path=program, args=["--no-sandbox"])
    if len(sys.argv) > 2:
        picture(browser, sys.argv[3])
    else:
        use(browser)
        print("all checks passed")
    browser.close()
