"""Watches flights under way in Chromium: early, late, and after the end.

Usage: live_page.py FOXHOUND --report FLIGHT.html    (the file for a flight to leave)
       live_page.py FOXHOUND --cut                   (kills the flight)
"""

import contextlib
import pathlib
import signal
import subprocess
import sys

from playwright.sync_api import sync_playwright

from checks import check, chromium, settle, watch
from report_records import records_of

# A flight that lasts a minute is under way on any machine while it is looked at. It is not waited for.
SLOW = ("--speed", "0.25")
# So many steps are a new picture.
STEPS = 10

program, mode, *file = sys.argv[1:]
troubles, requests, addresses = [], [], []


@contextlib.contextmanager
def flight(*options):
    """A flight that is served, and where; it is killed if it has not ended before."""
    command = [program, "fly", "--json", "--live", "--port", "0", *options]
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True) as process:
        try:
            line = next((line for line in process.stderr if line.startswith("live: ")), "")
            check(line, "the flight is served")
            addresses.append(line.removeprefix("live: ").strip())
            yield process, addresses[-1]
        finally:
            process.kill()


def opened(browser, address):
    """The page in a browser that tells of every complaint and every request."""
    page = browser.new_context(viewport={"width": 1280, "height": 880}).new_page()
    watch(page, troubles, requests)
    page.set_default_timeout(120_000)
    page.goto(address)
    page.wait_for_selector("#map[data-step]")
    return page


def until(page, condition, text, within_s=120):
    """Waits for what becomes true in the page, whose policy forbids it to be asked from inside."""
    for _ in range(within_s * 20):
        if page.evaluate(condition):
            return
        page.wait_for_timeout(50)
    check(False, text)


def state(page):
    """Which step is shown, where the drone is then, and how many steps there are."""
    settle(page)
    return page.evaluate("""() => ({
        step: Number(byId('map').dataset.step), place: [byId('map').dataset.x, byId('map').dataset.y].map(Number),
        last: Number(byId('time').max), first_s: flight.steps[0].time_s, verdict: byId('verdict').textContent,
        picture: byId('map').toDataURL() })""")


def moves_on(page):
    before = state(page)
    check(before["verdict"] == "under way", "the flight is under way")
    until(page, f"Number(byId('map').dataset.step) > {before['step'] + STEPS}", "another step is shown")
    # Who comes at the very beginning sees it stand for a moment.
    moved_m = "Math.hypot(byId('map').dataset.x - {}, byId('map').dataset.y - {})".format(*before["place"])
    until(page, f"{moved_m} > 0.05", "the drone moves on by itself")
    after = state(page)
    check(after["picture"] != before["picture"], "and so does the picture")
    # Steps that came may not be drawn yet.
    until(page, f"Number(byId('time').max) - Number(byId('map').dataset.step) <= {STEPS}", "at its end")


def looks_back(page):
    """Somebody looks at an earlier time while the flight goes on."""
    event = page.locator("#events button").first
    kept = event.element_handle()
    event.click()
    shown = state(page)
    until(page, f"Number(byId('time').max) > {shown['last'] + STEPS}", "steps come")
    later = state(page)
    check(later["step"] == shown["step"], "whoever looks back stays there while the flight goes on")
    check(kept.evaluate("(button) => button.isConnected"), "a line of what happened stays the same one")
    page.locator("h1").click()
    page.keyboard.press("End")
    check(state(page)["step"] > later["step"], "End leads to where the drone is")


def is_whole(page, records):
    """The finished report: what the file holds."""
    until(page, "flight.end !== null", "the flight ends")
    settle(page)
    of_kind = lambda kind: [record for record in records if record["kind"] == kind]
    check(page.evaluate("flight.begin") == records[0], "the header is that of the file")
    for name, kind in (("steps", "step"), ("plans", "plan"), ("remembered", "remembered")):
        check(page.evaluate(f"flight.{name}") == of_kind(kind), f"the {name} are those of the file")
    end = records[-1]
    check(page.evaluate("flight.end") == end, "and the end is")
    verdict = page.locator("#verdict").inner_text()
    check(verdict == f"{end['report']['result']} after {end['report']['time_s']:.1f} s", f"it says `{verdict}`")
    check(end["report"]["trace_hash"] in page.locator("#run").inner_text(), "and the trace hash")
    page.locator("h1").click()
    page.keyboard.press("Home")
    check(state(page)["step"] == 0, "Home is the beginning")
    page.keyboard.press("End")
    check(state(page)["step"] == len(of_kind("step")) - 1, "End is the end")


def follow(browser):
    with flight(*SLOW) as (_, address):
        early = opened(browser, address)
        moves_on(early)
        looks_back(early)
        late = opened(browser, address)
        seen = state(late)
        check(seen["first_s"] == 0 and seen["last"] > STEPS, "who comes late has the flight from the beginning")
        moves_on(late)
        for page in (early, late):
            page.close()
    to_the_end(browser, pathlib.Path(*file))
    check(not troubles, f"no error on the console {troubles}")
    others = [url for url in requests if not url.startswith((*addresses, "data:"))]
    check(not others, f"no request but to where the page came from {others}")


def to_the_end(browser, file):
    """One page has seen all of the flight, one comes later, one after the end."""
    with flight("--speed", "2", "--report", file) as (process, address):
        early = opened(browser, address)
        until(early, f"flight.steps.length > {STEPS}", "steps come")
        late = opened(browser, address)
        until(early, "flight.end !== null", "the flight ends")
        # It is written when the last record has been told.
        for _ in range(600):
            if file.exists() and file.read_text().rstrip().endswith("</html>"):
                break
            early.wait_for_timeout(50)
        records = records_of(file.read_text())
        for page in (early, late, opened(browser, address)):
            is_whole(page, records)
        asked = len(requests)
        early.wait_for_timeout(500)
        check(len(requests) == asked, "who has it all asks no more")
        process.send_signal(signal.SIGINT)
        check(process.wait(timeout=120) == 0, "it is served until Ctrl-C")


def cut(browser):
    with flight(*SLOW) as (process, address):
        page = opened(browser, address)
        moves_on(page)
        check(not troubles, f"no error on the console {troubles}")
        process.kill()
        says = "a flight that is cut off says so"
        until(page, "byId('verdict').textContent === 'cut off'", says)
    check(True, says)
    page.locator("h1").click()
    page.keyboard.press("Home")
    check(state(page)["step"] == 0, "and what was flown can be looked at")
    foreign = [text for text in troubles if "ERR_" not in text]
    check(not foreign, f"the browser misses the program and nothing else {foreign}")


with sync_playwright() as play:
    browser = chromium(play)
    (follow if mode == "--report" else cut)(browser)
    print("all checks passed")
    browser.close()
