// What was heard at the cursor: the spectrum of the antennas, and the tone's phases.

/** The antennas' colours. */
const ANTENNAS = ["blue", "orange", "green", "purple"];

function drawHeardSignal(step) {
  const signal = step && latest(flight.signals, step.time_s);
  byId("signal-words").textContent = signalWords(signal);
  drawSpectrum(byId("spectrum"), signal);
  drawPhases(byId("phases"), signal);
}

function signalWords(signal) {
  if (!flight.signals.length) return "This flight has no waveforms: its bearings are simulated, or come from outside.";
  if (!signal) return "Nothing heard yet.";
  const { tone, time_s } = signal;
  if (!tone) return `At ${seconds(time_s)}: no tone.`;
  const antennas = tone.phases_deg.map((deg, index) => `${index + 1}: ${deg.toFixed(1)} deg, ${tone.amplitudes[index].toFixed(0)}`);
  return `At ${seconds(time_s)}: tone at ${(tone.frequency_hz / 1000).toFixed(2)} kHz. Antenna and phase, amplitude in steps of the converter: ${antennas.join("; ")}.`;
}

/** Least and greatest power of all recorded spectra, so that the picture does not jump. */
const power = { signals: null, count: 0, range: [-90, 0] };
function powerRange() {
  const { signals } = flight;
  if (power.signals !== signals || power.count !== signals.length) {
    const every = Math.ceil(signals.length / 500);
    const [low, high] = extent(signals.filter((_, index) => index % every === 0).flatMap((signal) => signal.spectrum_db));
    Object.assign(power, { signals, count: signals.length, range: [Math.floor(Math.max(low, -110) / 10) * 10, Math.ceil((high + 3) / 10) * 10] });
  }
  return power.range;
}

function drawSpectrum(canvas, signal) {
  const picture = prepare(canvas);
  const { context, width, height } = picture;
  if (!width || !flight.signals.length) return;
  const { bin_hz } = flight.begin;
  const bins = flight.signals[0].spectrum_db.length;
  const top_khz = (bins * bin_hz) / 1000;
  const x = axisAcross(picture, top_khz, "kHz");
  const y = axisUp(picture, powerRange());
  write(context, "dB of full scale", EDGE.left + 4, EDGE.top + 8, { color: colors.faint, size: 10 });
  if (!signal) return;
  if (signal.tone) {
    const khz = signal.tone.frequency_hz / 1000;
    line(context, [[x(khz), EDGE.top], [x(khz), height - EDGE.bottom]], { color: colors.green, width: 1.5, dash: [4, 3] });
  }
  const wide = x((bin_hz / 1000)) - x(0);
  context.fillStyle = colors.blue;
  signal.spectrum_db.forEach((db, bin) => {
    const left = x((bin * bin_hz) / 1000);
    context.fillRect(left + 0.5, y(db), Math.max(wide - 1, 1), height - EDGE.bottom - y(db));
  });
  const loudest = signal.spectrum_db.indexOf(Math.max(...signal.spectrum_db));
  const at = `loudest at ${((loudest + 0.5) * bin_hz / 1000).toFixed(1)} kHz with ${signal.spectrum_db[loudest]} dB`;
  canvas.dataset.time = String(signal.time_s);
  canvas.setAttribute("aria-label", `Spectrum from 0 to ${top_khz.toFixed(1)} kHz: ${at}`);
}

/** The four phasors: as long as the amplitude, turned by the phase after the first antenna. */
function drawPhases(canvas, signal) {
  const { context, width, height } = prepare(canvas);
  if (!width || !flight.signals.length) return;
  const middle = [width / 2, height / 2];
  const radius = Math.min(width, height) / 2 - 22;
  disc(context, middle, radius, { stroke: colors.line });
  disc(context, middle, radius / 2, { stroke: colors.grid });
  for (const deg of [0, 90, 180, 270]) {
    const [dx, dy] = [Math.cos((deg * Math.PI) / 180), -Math.sin((deg * Math.PI) / 180)];
    line(context, [middle, [middle[0] + radius * dx, middle[1] + radius * dy]], { color: colors.grid });
    write(context, `${deg}\u00b0`, middle[0] + (radius + 12) * dx, middle[1] + (radius + 12) * dy, { color: colors.faint, align: "center", base: "middle", size: 10 });
  }
  const tone = signal && signal.tone;
  canvas.setAttribute("aria-label", tone ? `Phases at the four antennas, degrees: ${tone.phases_deg.join(", ")}` : "Phases at the four antennas: no tone");
  if (!tone) return;
  const most = Math.max(...tone.amplitudes, 1e-9);
  tone.phases_deg.forEach((deg, index) => {
    const [angle, long] = [(deg * Math.PI) / 180, (radius * tone.amplitudes[index]) / most];
    const shift = [long * Math.cos(angle), -long * Math.sin(angle)];
    arrow(context, middle, shift, { color: colors[ANTENNAS[index]], width: 2.6 });
    const [x, y] = [middle[0] + shift[0] * 0.72, middle[1] + shift[1] * 0.72];
    disc(context, [x, y], 7.5, { fill: colors.panel, stroke: colors[ANTENNAS[index]], width: 1.5 });
    write(context, String(index + 1), x, y + 0.5, { color: colors.ink, align: "center", base: "middle", size: 10, weight: "600" });
  });
}
