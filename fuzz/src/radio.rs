//! Readers of what direction finders send over a serial line.

use foxhound_computer::iq::Reports;
use foxhound_computer::radio::Radio;
use foxhound_core::base::time::Instant;
use foxhound_core::doa::radio::{Mount, Sends};
use foxhound_link::radio::{hci, uudf};

use super::{Draw, Reached};

/// Arbitrary bytes, and valid and damaged IQ reports and angle lines: valid ones after valid ones are found, and all values are in range.
pub fn radio(case: &[u8]) -> Reached {
    let draw = &mut Draw { rest: case };
    let mut reached = Reached { configured: true, ..Reached::default() };
    let (mut reports, mut lines) = (hci::Reader::new(), uudf::Reader::default());
    let mut is_clean = true;
    let tag = if draw.flag() { 0 } else { draw.word() & 0xFF_FFFF };
    let mount = Mount { yaw_rad: draw.field(0.0, -3.1, 3.1), tag, ..Mount::default() };
    if mount.check().is_err() {
        return Reached::default();
    }
    let mut radio = Radio::new(mount);
    let of_reports = Mount { sends: Sends::IqReports, ..mount };
    let (mut line, mut board) = (Radio::new(of_reports), Reports::new());
    assert!(board.begin(&of_reports).is_ok());
    while !draw.rest.is_empty() {
        let count = match draw.below(8) {
            0 => draw.byte(),
            1 => 0,
            _ => 9 + draw.below(74),
        };
        let is_sane = count == 0 || (9..=82).contains(&count);
        let mut bytes = vec![4, 0x3E, 0, 0x15, draw.byte(), draw.below(16), draw.below(40), 0x18, 0xFD, 0];
        bytes.extend([draw.below(3), 1 + draw.below(2), draw.below(3), draw.byte(), draw.byte(), count]);
        bytes.extend((0..u16::from(count.min(119)) * 2).map(|_| draw.byte()));
        bytes[2] = (bytes.len() - 3) as u8;
        match draw.below(6) {
            0 => {
                let at = usize::from(draw.byte()) % bytes.len();
                bytes[at] ^= draw.byte();
                is_clean = false;
            }
            1 => {
                bytes.truncate(usize::from(draw.byte()) % bytes.len());
                is_clean = false;
            }
            _ => {}
        }
        let before = reports.counters().reports;
        let known = line.counters();
        line.push(Instant(1), &bytes, &mut board);
        let now = line.counters();
        assert!(line.bearing().is_none() || now.angles > known.angles, "a bearing without a report");
        if let Some(bearing) = line.bearing() {
            let (azimuth_rad, sigma_rad) = (bearing.azimuth_rad, bearing.sigma_rad);
            assert!(bearing.valid && azimuth_rad.abs() <= core::f32::consts::PI + 1e-4, "{bearing:?}");
            assert!(sigma_rad >= mount.sigma_rad.min(1.0) - 1e-6 && sigma_rad <= core::f32::consts::PI, "{bearing:?}");
        }
        line.take();
        board.end_step();
        for byte in &bytes {
            if let Some(Ok(report)) = reports.push(*byte) {
                reached.answers += 1;
                reached.usable += u32::from(report.is_usable());
                let (reference, slots) = (report.reference().len(), report.slots().len());
                assert!((reference, slots) == (0, 0) || reference == 8 && (1..=74).contains(&slots), "{report:?}");
                assert!(
                    report.handle <= 0x0FFF && report.channel < 40 && (1..=2).contains(&report.slot_us),
                    "{report:?}"
                );
            }
        }
        let found = reports.counters().reports - before;
        assert!(!is_clean || found == u32::from(is_sane), "{found} of a whole report");
        if !is_clean && draw.flag() {
            (reports, is_clean) = (hci::Reader::new(), true);
        }

        let text = format!(
            "+UUDF:{:012X},{},{},{},0,{},\"CCF9579B21AE\",\"\",{}\r\n",
            draw.word(),
            -(i16::from(draw.byte()) / 2),
            i16::from(draw.byte()) * 2 - 256,
            i16::from(draw.byte()) - 128,
            draw.below(44),
            draw.word()
        );
        let mut text = text.into_bytes();
        if draw.below(4) == 0 {
            let at = usize::from(draw.byte()) % text.len();
            text[at] = draw.byte();
        }
        radio.push(Instant(1), &text, &mut Reports::new());
        let before = reached.settled;
        for byte in text {
            if let Some(Ok(angle)) = lines.push(byte) {
                reached.settled += 1;
                assert!(
                    angle.azimuth_deg.abs() <= 180 && angle.elevation_deg.abs() <= 90 && angle.channel < 40,
                    "{angle:?}"
                );
            }
        }
        if let Some(bearing) = radio.bearing() {
            assert!(reached.settled > before, "a bearing without an angle");
            assert!(
                bearing.azimuth_rad.abs() <= core::f32::consts::PI + 1e-4 && bearing.time == Instant(1),
                "{bearing:?}"
            );
            radio.take();
        }
    }
    let counters = radio.counters();
    assert_eq!(counters.angles + counters.others, reached.settled, "{counters:?}");
    reached
}
