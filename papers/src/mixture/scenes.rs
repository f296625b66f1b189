//! Fixed scenes, and what scikit-learn makes of them.
//!
//! Points with noise of 0.05 m, rounded to centimetres, from numpy's generator `default_rng(5)`. The oracle is scikit-learn
//! 1.9.1, `BayesianGaussianMixture(n_components=8, weight_concentration_prior_type="dirichlet_process",
//! weight_concentration_prior=0.1, mean_precision_prior=0.001, mean_prior=X.mean(0), degrees_of_freedom_prior=2,
//! covariance_prior=2 * 0.05**2 * eye(2), reg_covar=0, n_init=50, max_iter=5000, tol=1e-8, random_state=1)`: for each label
//! of `predict` with at least four points, the two outermost of them projected on the first eigenvector through their mean.

use foxhound_core::base::ned::Horizontal;
use std::vec::Vec;

/// Three walls that meet in two corners, as in the belief-space paper's fig. 1; north and east in turn.
const THREE_WALLS_CM: [i16; 192] = [
    687, 298, 759, 523, 390, -5, 667, 237, 177, 878, 694, 341, 777, 606, 490, 9, 50, -2, 603, 10, 760, 589, 150, -2,
    680, 734, 647, 198, 781, 628, 737, 462, 703, 734, 744, 504, 764, 565, 631, 114, 744, 713, 305, 830, 789, 702, 590,
    750, 130, 1, 352, 828, 530, 1, 70, -2, 10, -2, 525, 774, 721, 444, 637, 750, 170, 1, 327, 825, 766, 704, 684, 277,
    290, -5, 270, 2, 711, 425, 642, 155, 793, 669, 131, 886, 659, 744, 350, -3, 30, 1, 590, -5, 410, 0, 623, 94, 616,
    761, 395, 816, 510, -6, 670, 258, 570, -5, 330, 0, 659, 217, 470, 2, 801, 688, 687, 320, 550, -2, 569, 761, 503,
    778, 634, 135, 374, 823, 787, 648, 430, 5, 110, 895, 90, -4, 450, -2, 265, 858, 550, 777, 190, 10, 154, 882, 238,
    846, 486, 802, 310, 5, 709, 381, 222, 870, 617, 51, 732, 486, 722, 399, 210, 2, 287, 849, 416, 806, 607, 31, 250,
    9, 725, 726, 648, 176, 758, 545, 620, 72, 440, 805, 370, -3, 199, 875, 462, 800, 110, -3, 230, -8, 695, 362,
];

/// Three sides of a room of 8 m by 6 m and five pillars.
const ROOM_CM: [i16; 130] = [
    -108, 295, 393, -57, 262, 300, -401, 195, 150, -200, -398, -285, -77, 304, -394, 285, 354, 302, 292, 297, 403, 0,
    -169, 299, -406, -45, -200, 100, -404, 15, -138, 300, -354, 300, 0, 0, 399, 200, -46, 297, -404, 105, 410, 229,
    395, 143, 405, 257, 387, -29, -399, 255, 169, 305, 393, 114, -15, 295, 15, 296, -323, 300, 399, 286, -231, 303,
    138, 292, -400, -15, -292, 300, 323, 297, -400, -255, 46, 301, -200, 298, -180, -220, -406, -135, 231, 306, -385,
    306, 394, 171, 200, 100, -398, 165, -398, -195, -393, 45, 396, 57, -396, -105, -399, 135, -409, 75, 410, -86, 77,
    304, -399, 225, -262, 288, -391, -75, 397, 86, 385, 304, 200, 295, 108, 297, -403, -165, 393, 29, -402, -225,
];

/// What scikit-learn finds in [`three_walls`]: north and east of both ends.
pub(super) const THREE_WALLS_FOUND: [[f32; 4]; 3] =
    [[6.0005, 0.1086, 7.9803, 6.8887], [5.9001, -0.0075, 0.1, 0.0002], [7.8957, 7.0404, 1.0997, 8.9489]];

/// What scikit-learn finds in [`room`]; of the pillars three are left alone and two are one component.
pub(super) const ROOM_FOUND: [[f32; 4]; 3] =
    [[-4.0076, -2.8499, -3.9924, 2.8501], [3.9576, -0.8582, 4.0053, 2.8598], [3.8501, 2.9973, -3.8499, 2.9881]];

/// The walls that [`three_walls`] was made from.
pub(super) const THREE_WALLS: [[f32; 4]; 3] = [[0.0, 0.0, 6.0, 0.0], [6.0, 0.0, 8.0, 7.0], [8.0, 7.0, 1.0, 9.0]];

/// The walls that [`room`] was made from.
pub(super) const ROOM: [[f32; 4]; 3] = [[-4.0, -3.0, -4.0, 3.0], [-4.0, 3.0, 4.0, 3.0], [4.0, 3.0, 4.0, -1.0]];

/// 96 points of three walls.
pub(super) fn three_walls() -> Vec<Horizontal> {
    places(&THREE_WALLS_CM)
}

/// 60 points of three walls, and five pillars.
pub(super) fn room() -> Vec<Horizontal> {
    places(&ROOM_CM)
}

fn places(cm: &[i16]) -> Vec<Horizontal> {
    let metres = |value: i16| f32::from(value) / 100.0;
    cm.as_chunks().0.iter().map(|&[north, east]| Horizontal { north: metres(north), east: metres(east) }).collect()
}
