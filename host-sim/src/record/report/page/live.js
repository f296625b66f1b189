// A flight under way: asks for the records that are not here yet, until the last one is.

const ASK_EVERY_MS = 100;
/** So often in a row it may be refused or cut off before that is the end. */
const TRIES = 10;
let known = 0;
let failed = 0;
/** How long it took to draw what came last. */
let drawing_ms = 0;

async function ask() {
  try {
    const answer = await fetch(`records?from=${known}`, { cache: "no-store" });
    if (!answer.ok) throw new Error(answer.statusText);
    const lines = (await answer.text()).split("\n").filter(Boolean);
    known += lines.length;
    failed = 0;
    lines.forEach((line) => add(JSON.parse(line)));
  } catch {
    failed += 1;
    if (failed < TRIES) return void setTimeout(ask, ASK_EVERY_MS);
    // Whoever flies has ended, or was ended: what is here stays.
    flight.cut = true;
    if (flight.begin) showResult();
    return;
  }
  if (flight.end) return;
  measureDrawing();
  // The longer the flight, the longer its pictures take: half of the time is for whoever uses the page.
  setTimeout(ask, Math.max(ASK_EVERY_MS, 2 * drawing_ms));
}

/** New records are drawn in the picture after the next. */
function measureDrawing() {
  const since_ms = performance.now();
  const done = () => (drawing_ms = performance.now() - since_ms);
  requestAnimationFrame(() => requestAnimationFrame(() => setTimeout(done)));
}

ask();
