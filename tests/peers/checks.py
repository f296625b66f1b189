"""What the scripts that check something share."""

import shutil
import sys

BROWSERS = ("chromium", "chromium-browser", "google-chrome")


def check(condition, text):
    if not condition:
        print("FAILED:", text)
        sys.exit(1)
    print("ok:", text)


def chromium(play, *flags):
    """The browser. Its sandbox does not work for root; nothing foreign is opened."""
    program = next(filter(None, map(shutil.which, BROWSERS)), None)
    check(program, "there is a Chromium")
    return play.chromium.launch(executable_path=program, args=["--no-sandbox", *flags])


def watch(page, troubles, requests, harmless=None):
    """Notes every complaint and every request of a page."""
    page.on("console", lambda message: troubles.append(message.text) if message.type in ("error", "warning") and not (harmless and harmless in message.text) else None)
    page.on("pageerror", lambda error: troubles.append(str(error)))
    page.on("request", lambda request: requests.append(request.url))


def settle(page):
    """Until what was done is drawn: the picture after the next."""
    page.wait_for_timeout(30)
    page.evaluate("new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(() => requestAnimationFrame(done))))")
