"""Opens the page of `foxhound reproduce all` in Chromium, without network, on a desk and on a phone.

Usage: papers_page.py FOLDER/index.html
"""

import pathlib
import sys

from playwright.sync_api import sync_playwright

from checks import check, chromium

SIZES = ({"width": 1280, "height": 900}, {"width": 360, "height": 700})

path = pathlib.Path(sys.argv[1]).resolve()
troubles, requests = [], []

with sync_playwright() as playwright:
    browser = chromium(playwright)
    for size in SIZES:
        page = browser.new_context(offline=True, viewport=size).new_page()
        page.on("console", lambda message: troubles.append(message.text))
        page.on("pageerror", lambda error: troubles.append(str(error)))
        page.on("requestfailed", lambda request: troubles.append(request.url))
        page.on("request", lambda request: requests.append(request.url))
        page.goto(path.as_uri())
        # Figures are fetched when they come into sight.
        figures = page.locator("img")
        for index in range(figures.count()):
            figures.nth(index).scroll_into_view_if_needed()
        page.wait_for_function("[...document.images].every(image => image.complete && image.naturalWidth > 100)")
        check(figures.count() == len(list(path.parent.glob("*/*.svg"))), "every figure is shown")
        wide = page.evaluate("document.documentElement.scrollWidth - document.documentElement.clientWidth")
        check(wide <= 0, f"nothing is cut off at {size['width']} pixels")
        for link in page.locator("a").all():
            where = link.get_attribute("href")
            there = page.locator(f"section{where}").count() == 1 if where[0] == "#" else (path.parent / where).is_file()
            check(there, where)
        summary = page.locator("summary").first
        summary.focus()
        page.keyboard.press("Enter")
        check(page.locator("details[open] pre").is_visible(), "the numbers unfold by key")
    browser.close()

check(not troubles, f"no complaint {troubles}")
check(all(url.startswith(path.parent.as_uri()) or url.startswith("data:") for url in requests), "nobody was asked")
