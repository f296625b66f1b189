//! Four channels of samples become a bearing: `cargo run --package foxhound-core --example bearing`.

use foxhound_core::ConfigError;
use foxhound_core::base::adc::AdcFrame;
use foxhound_core::doa::{array, bearing};
use foxhound_core::signal::phase;

/// Samples a channel and frame.
const N: usize = 256;

/// What four antennas receive of a tone of 10 kHz from a direction: the antenna that is nearer hears it earlier.
fn frame(array: &array::Config, sample_rate_hz: f32, azimuth_rad: f32) -> AdcFrame<N> {
    let mut frame = AdcFrame::zeroed();
    for (channel, [forward_m, right_m]) in frame.codes.iter_mut().zip(array.antennas_m) {
        let nearer_m = forward_m * azimuth_rad.cos() + right_m * azimuth_rad.sin();
        for (n, code) in channel.iter_mut().enumerate() {
            let turns = 10_000.0 * n as f32 / sample_rate_hz + nearer_m / array.wavelength_m;
            *code = (900.0 * (std::f32::consts::TAU * turns).cos()) as i16;
        }
    }
    frame
}

fn main() -> Result<(), ConfigError> {
    let (phase, array) = (phase::Config::default(), array::Config::default());
    let extractor = phase.build::<N>()?;
    let estimator = bearing::Config::default().build(array.build()?)?;
    let mut state = phase::State::default();
    for azimuth_deg in [-120.0_f32, 0.0, 33.0] {
        let frame = frame(&array, phase.sample_rate_hz, azimuth_deg.to_radians());
        let bearing = estimator.estimate(&extractor.step(&mut state, &frame));
        let (found_deg, sigma_deg) = (bearing.azimuth_rad.to_degrees(), bearing.sigma_rad.to_degrees());
        println!("from {azimuth_deg:6.1} deg: {found_deg:8.3} deg, sigma {sigma_deg:.3}, valid: {}", bearing.valid);
        assert!(bearing.valid && (found_deg - azimuth_deg).abs() < 0.1);
    }
    let silence = estimator.estimate(&extractor.step(&mut state, &AdcFrame::zeroed()));
    println!("from nowhere: valid: {}", silence.valid);
    assert!(!silence.valid);
    Ok(())
}
