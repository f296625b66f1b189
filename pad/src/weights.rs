//! The weights of the score, and where they come from.
//!
//! Trained on 42 000 regions of pictures that `camera::random` drew, with a pad (28 000, seeds 100 000 to 130 000, and 2 500 that the border cuts) and
//! without (100 000 to 152 000, and 47 000 from 300 000 on); those that the tests draw are others. Logistic loss, a decay of the weights of 3e-4,
//! Adam over 300 epochs on two of three seeds; of three starts the best on the third of the seeds, rounded to
//! sixteenths. Where the score is zero was chosen on seeds from 300 000 on, some of which it was trained on.

use super::score::MEASURES;

/// Each measure's mean over the regions, and one over its standard deviation.
pub(super) const SCALES: [[f32; 2]; MEASURES] = [
    [-0.154, 3.27],
    [0.334, 6.3],
    [0.884, 5.0],
    [0.792, 4.87],
    [0.832, 4.25],
    [0.0704, 7.14],
    [0.482, 1.29],
    [0.52, 1.31],
    [0.071, 13.9],
    [0.033, 11.8],
    [-0.00697, 23.0],
    [0.0147, 15.3],
    [0.442, 18.2],
    [0.137, 8.98],
    [0.347, 11.0],
    [-0.0247, 9.41],
    [-0.0726, 6.85],
    [0.42, 3.42],
    [0.583, 3.02],
    [0.919, 5.69],
    [0.885, 4.86],
];

/// Of each unit: the weights of the measures and the bias, in sixteenths, and what the unit counts.
pub(super) const UNITS: [([i8; MEASURES], i8, i8); 12] = [
    ([11, 33, -88, 126, 74, 7, -41, 18, -113, 34, 31, -9, -16, 16, -9, -19, 12, 20, -45, -42, 51], -80, -66),
    ([126, -29, -3, -38, 2, 15, -101, 66, 122, -27, 7, 44, 0, -10, 4, -1, -3, 45, 13, 25, -50], 31, -79),
    ([-25, -8, 10, 12, 2, -40, -9, -28, 16, -2, -7, 21, 17, 1, -24, 14, -126, 2, 12, 3, 22], -37, 77),
    ([37, -7, 9, 5, -10, -19, -39, -36, -4, 44, 4, -38, -66, 30, -14, 61, 4, -6, -7, 10, -13], -126, -77),
    ([-126, -3, 3, -32, 126, 50, 80, -24, -24, -69, 40, 64, -16, 36, -17, 42, 69, 0, -19, 39, -28], -15, -50),
    ([-10, -23, 126, 46, 23, -22, -21, 5, -68, 31, 28, 2, 26, -57, -17, 4, -5, 33, 41, -48, 22], -102, -113),
    ([20, -11, 103, 24, 23, -45, 46, -22, -47, -1, 65, -125, 8, -5, 3, 24, 15, 52, -24, 3, -17], 126, 56),
    ([2, 3, 30, -34, -6, 16, -14, 15, 4, -126, -18, 12, -2, -11, 9, -11, -5, 10, 22, 22, -39], 56, -126),
    ([-1, -22, 41, -47, 48, -7, 56, -103, 126, 30, -26, -5, -66, -52, -10, -105, -32, -18, 16, 18, -15], -112, -99),
    ([14, 15, 117, 74, 49, -43, -48, -102, -31, 35, -9, -49, -6, 3, 8, -12, -6, 7, -10, 33, 73], 126, 105),
    ([5, 29, -9, 117, -39, 22, -30, 29, 31, -47, -23, 3, -51, 82, 16, 24, 8, 126, 94, -118, -8], -117, -68),
    ([-17, 34, 28, -17, -126, -3, 15, -39, -32, 49, 9, 22, 36, -28, 5, 44, 48, 5, -41, 4, -19], -36, -55),
];

/// What a count is worth, and what the score is without any.
pub(super) const WORTH: f32 = 0.000223;
pub(super) const NONE: f32 = 0.132;
