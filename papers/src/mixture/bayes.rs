//! Clusters of unordered points: variational Bayes for a Dirichlet-process mixture of Gaussians.
//!
//! The belief-space paper's choice (section III, its reference 17: D. M. Blei and M. I. Jordan, "Variational inference for
//! Dirichlet process mixtures", Bayesian Analysis 1, 2006): stick-breaking weights truncated at [`COMPONENTS`], of Beta
//! posteriors, and a normal-Wishart posterior for each component's mean and precision. One round is
//!
//! - points: `ln rho_k = E ln pi_k + (psi(nu/2) + psi((nu-1)/2) + 2 ln 2 + ln|W|) / 2 - 1/beta - nu/2 (x-m)^T W (x-m)`,
//!   with `E ln pi_k = psi(a_k) - psi(a_k + b_k) + sum_(j<k) (psi(b_j) - psi(a_j + b_j))`, normalised over the components;
//! - components: `a = 1 + N`, `b_k = alpha + sum_(j>k) N_j`, `beta = beta_0 + N`, `nu = nu_0 + N`,
//!   `m = (beta_0 m_0 + N xbar) / beta`, `W^-1 = W_0^-1 + N S + beta_0 N / beta (xbar - m_0)(xbar - m_0)^T`.
//!
//! The responsibilities of a point are used at once and never stored. A test holds a round against scikit-learn's.
//!
//! Without intervention, two components on one wall need many rounds until one has absorbed the other. So after every
//! few rounds two components that together are one thin line are joined, and those without points are dropped.

use heapless::Vec;

use foxhound_core::base::math::sqrt;
use foxhound_core::base::ned::Horizontal;
use foxhound_core::mapping::walls::POINTS_MAX;
use foxhound_core::mapping::walls::fit::Moments;

/// Truncation of the stick-breaking.
pub(super) const COMPONENTS: usize = 12;
/// A component with less than this share of a point in it vanishes.
const VANISHED: f32 = 0.5;
/// Degrees of freedom of the prior: the dimension, the least informative one that scikit-learn takes as well.
const FREEDOM: f32 = 2.0;
/// Weight of the prior's mean, in points.
const MEAN_PRECISION: f32 = 0.001;
/// Responsibilities below `exp(-CUT)` of the largest are none.
const CUT: f32 = 12.0;
/// Rounds between two attempts to join components.
const ROUNDS: u8 = 2;
/// What is done for a point once in a round, in units of what is done for each component.
const POINT_WORK: u32 = 6;
/// The mixture has settled when no component gained or lost more points than this in a round.
const SETTLED: f32 = 0.05;

/// Prior, and stopping rule.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Prior {
    /// Concentration of the Dirichlet process, `alpha`.
    pub(super) concentration: f32,
    /// Expected standard deviation of a component, which only matters where it is thin.
    pub(super) sigma_m: f32,
    /// Two components may be joined that are no thicker than this together (standard deviation),
    pub(super) joined_m: f32,
    /// and no farther apart.
    pub(super) gap_m: f32,
    /// Most work: a round has one for each pair of a point and a component, and [`POINT_WORK`] for each point.
    pub(super) work_max: u32,
}

/// Posterior of a component.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Component {
    /// Its points, weighted by how much they are its own.
    pub(super) moments: Moments,
    /// Posterior mean `m`.
    mean_ned_m: Horizontal,
    /// `nu W / 2`, with the entry off the diagonal doubled: a point's squared distance is three products.
    form: [f32; 3],
    /// All of `ln rho` that does not depend on the point, but for `ln pi`; once per round that as well.
    constant: f32,
    /// Sums of responsibilities, and of the points from the posterior mean.
    weight: f32,
    first_m: Horizontal,
    second_m2: [f32; 3],
}

/// State of the computation.
#[derive(Clone, Debug)]
pub(super) struct Mixture {
    pub(super) components: Vec<Component, COMPONENTS>,
    /// Mean of the points, the prior's mean.
    prior_mean_ned_m: Horizontal,
    /// The squared distance of each point from the nearest seed.
    nearest_m2: [f32; POINTS_MAX],
    /// Work done so far, see [`Prior::work_max`].
    pub(super) work: u32,
}

impl Mixture {
    pub(super) const fn new() -> Self {
        Self {
            components: Vec::new(),
            prior_mean_ned_m: Horizontal { north: 0.0, east: 0.0 },
            nearest_m2: [0.0; POINTS_MAX],
            work: 0,
        }
    }

    /// Finds the clusters of points, which are finite. Which seed a point was nearest to is left in `owners`.
    pub(super) fn cluster(&mut self, prior: &Prior, points: &[Horizontal], owners: &mut [u8; POINTS_MAX]) {
        self.components.clear();
        self.work = 0;
        self.seed(prior, points, owners);
        let mut rounds = 0;
        loop {
            let round = points.len() as u32 * (self.components.len() as u32 + POINT_WORK);
            if self.work + round > prior.work_max {
                break;
            }
            self.work += round;
            self.observe(points);
            let moved = self.maximise(prior);
            rounds += 1;
            if rounds < ROUNDS && moved > SETTLED {
                continue;
            }
            rounds = 0;
            let joined = self.join(prior);
            if moved <= SETTLED && !joined {
                break;
            }
        }
        self.join(prior);
    }

    /// One component for each of a few points that are far from each other, with the points that are nearest to it.
    fn seed(&mut self, prior: &Prior, points: &[Horizontal], owners: &mut [u8; POINTS_MAX]) {
        let mut all = Moments::new();
        for point in points {
            all.add(*point);
        }
        self.prior_mean_ned_m = all.mean_ned_m;
        let mut farthest = None;
        let mut most = -1.0;
        for (point, least) in points.iter().zip(&mut self.nearest_m2) {
            *least = f32::INFINITY;
            let squared = point.minus(all.mean_ned_m).norm_squared();
            if squared > most {
                (farthest, most) = (Some(*point), squared);
            }
        }
        while let Some(seed) = farthest.filter(|_| !self.components.is_full()) {
            let number = self.components.len() as u8;
            let _ = self.components.push(Component::default());
            (farthest, most) = (None, 0.0);
            for ((point, owner), least) in points.iter().zip(&mut *owners).zip(&mut self.nearest_m2) {
                let squared = point.minus(seed).norm_squared();
                if squared < *least {
                    (*owner, *least) = (number, squared);
                }
                if *least > most {
                    (farthest, most) = (Some(*point), *least);
                }
            }
        }
        for (point, owner) in points.iter().zip(&*owners) {
            if let Some(component) = self.components.get_mut(usize::from(*owner)) {
                component.moments.add(*point);
            }
        }
        self.update(prior);
    }

    /// The sums over the points, with the responsibilities of the posterior.
    fn observe(&mut self, points: &[Horizontal]) {
        for component in &mut self.components {
            component.weight = 0.0;
            component.first_m = Horizontal::default();
            component.second_m2 = [0.0; 3];
        }
        for point in points {
            let mut shares = [0.0_f32; COMPONENTS];
            let mut most = f32::NEG_INFINITY;
            for (share, component) in shares.iter_mut().zip(&self.components) {
                let away = point.minus(component.mean_ned_m);
                let [nn, ne, ee] = component.form;
                *share =
                    component.constant - (away.north * (nn * away.north + ne * away.east) + ee * away.east * away.east);
                most = if *share > most { *share } else { most };
            }
            let mut total = 0.0;
            for (share, _) in shares.iter_mut().zip(&self.components) {
                let below = *share - most;
                *share = if below > -CUT { exp_below_zero(below) } else { 0.0 };
                total += *share;
            }
            let scale = 1.0 / total;
            for (share, component) in shares.iter().zip(&mut self.components) {
                if *share > 0.0 {
                    let weight = share * scale;
                    let away = point.minus(component.mean_ned_m);
                    let weighted = away.times(weight);
                    component.weight += weight;
                    component.first_m = component.first_m.plus(weighted);
                    let [nn, ne, ee] = component.second_m2;
                    component.second_m2 = [
                        nn + weighted.north * away.north,
                        ne + weighted.north * away.east,
                        ee + weighted.east * away.east,
                    ];
                }
            }
        }
    }

    /// The posterior from the sums. Returns by how many points the component changed that changed most.
    fn maximise(&mut self, prior: &Prior) -> f32 {
        let mut moved = 0.0;
        for component in &mut self.components {
            let change = libm::fabsf(component.weight - component.moments.count);
            moved = if change > moved { change } else { moved };
            component.moments = component.summed();
        }
        self.components.retain(|component| component.moments.count > VANISHED);
        self.update(prior);
        moved
    }

    /// The posterior from the moments.
    fn update(&mut self, prior: &Prior) {
        for component in &mut self.components {
            component.update(prior, self.prior_mean_ned_m);
        }
        let mut rest: f32 = self.components.iter().map(|component| component.moments.count).sum();
        let mut before = 0.0;
        for component in &mut self.components {
            rest -= component.moments.count;
            let (a, b) = (1.0 + component.moments.count, prior.concentration + if rest > 0.0 { rest } else { 0.0 });
            let both = digamma(a + b);
            component.constant += digamma(a) - both + before;
            before += digamma(b) - both;
        }
    }

    /// Joins the two components that are the thinnest line together, as long as there are such. Whether there were.
    fn join(&mut self, prior: &Prior) -> bool {
        let mut joined = false;
        while let Some((first, second)) = self.thinnest(prior) {
            if second >= self.components.len() {
                break;
            }
            let other = self.components.swap_remove(second);
            let Some(component) = self.components.get_mut(first) else { break };
            component.moments = component.moments.joined(&other.moments);
            joined = true;
        }
        if joined {
            self.update(prior);
        }
        joined
    }

    /// The first is before the second.
    fn thinnest(&self, prior: &Prior) -> Option<(usize, usize)> {
        let mut best = None;
        let mut least = prior.joined_m * prior.joined_m;
        for (second, b) in self.components.iter().enumerate() {
            for (first, a) in self.components.iter().enumerate().take(second) {
                let Some(spread) = a.moments.joined(&b.moments).spread() else { continue };
                if spread.across_m2 < least
                    && libm::fabsf(spread.along_ned.dot(b.moments.mean_ned_m.minus(a.moments.mean_ned_m)))
                        <= prior.gap_m + a.half_length_m(spread.along_ned) + b.half_length_m(spread.along_ned)
                {
                    (best, least) = (Some((first, second)), spread.across_m2);
                }
            }
        }
        best
    }
}

impl Component {
    /// Half the length, in a direction, of evenly spread points with its moments.
    fn half_length_m(&self, along: Horizontal) -> f32 {
        let [nn, ne, ee] = self.moments.scatter_m2;
        let squares = along.north * (nn * along.north + 2.0 * ne * along.east) + ee * along.east * along.east;
        sqrt(3.0 * if squares > 0.0 { squares } else { 0.0 } / self.moments.count)
    }

    /// The moments that the sums make.
    fn summed(&self) -> Moments {
        let shift = self.first_m.times(1.0 / self.weight);
        let [nn, ne, ee] = self.second_m2;
        let first = self.first_m;
        Moments {
            count: self.weight,
            mean_ned_m: self.mean_ned_m.plus(shift),
            scatter_m2: [nn - first.north * shift.north, ne - first.north * shift.east, ee - first.east * shift.east],
        }
    }

    /// Mean, form and constant from the moments.
    fn update(&mut self, prior: &Prior, prior_mean_ned_m: Horizontal) {
        let Moments { count, mean_ned_m, scatter_m2 } = self.moments;
        let mean_precision = MEAN_PRECISION + count;
        let freedom = FREEDOM + count;
        let apart = mean_ned_m.minus(prior_mean_ned_m);
        let pull = MEAN_PRECISION / mean_precision;
        self.mean_ned_m = mean_ned_m.minus(apart.times(pull));
        // The inverse of W.
        let own = FREEDOM * prior.sigma_m * prior.sigma_m;
        let between = pull * count;
        let nn = own + scatter_m2[0] + between * apart.north * apart.north;
        let ne = scatter_m2[1] + between * apart.north * apart.east;
        let ee = own + scatter_m2[2] + between * apart.east * apart.east;
        // What rounding may leave of the determinant of a thin component is at least the prior's share of it.
        let least = own * (nn + ee) * 0.25;
        let determinant = nn * ee - ne * ne;
        let determinant = if determinant > least { determinant } else { least };
        let scale = 0.5 * freedom / determinant;
        self.form = [ee * scale, -2.0 * ne * scale, nn * scale];
        let halves = digamma(0.5 * freedom) + digamma(0.5 * (freedom - 1.0));
        self.constant = 0.5 * (halves - libm::logf(determinant)) - 1.0 / mean_precision;
    }
}

/// `e^x` for `x` in `-80..=0`, within a millionth of itself: `2^n` times a polynomial, a third of `libm`'s instructions.
fn exp_below_zero(x: f32) -> f32 {
    let turns = x * core::f32::consts::LOG2_E;
    let whole = (turns - 0.5) as i32;
    let y = (turns - whole as f32) * core::f32::consts::LN_2;
    let series =
        1.0 + y * (1.0 + y * (0.5 + y * (1.0 / 6.0 + y * (1.0 / 24.0 + y * (1.0 / 120.0 + y * (1.0 / 720.0))))));
    series * f32::from_bits(((127 + whole.clamp(-126, 0)) as u32) << 23)
}

/// The logarithmic derivative of the gamma function, for `x > 0`: recurrence up to 4, then the asymptotic series.
fn digamma(x: f32) -> f32 {
    let (mut x, mut sum) = (x, 0.0);
    // At most four times.
    while x < 4.0 && x > 0.0 {
        sum -= 1.0 / x;
        x += 1.0;
    }
    let inverse = 1.0 / x;
    let square = inverse * inverse;
    let series = square * (1.0 / 12.0 - square * (1.0 / 120.0 - square * (1.0 / 252.0 - square * (1.0 / 240.0))));
    sum + libm::logf(x) - 0.5 * inverse - series
}

#[cfg(test)]
mod tests {
    use super::super::scenes;
    use super::*;

    const PRIOR: Prior = Prior { concentration: 0.1, sigma_m: 0.05, joined_m: 0.1, gap_m: 1.25, work_max: 8_000 };

    /// Printed by `scipy.special.digamma`.
    const DIGAMMA: [(f32, f32); 9] = [
        (0.05, -20.4978),
        (0.5, -1.96351),
        (1.0, -core::f32::consts::EULER_GAMMA),
        (1.5, 0.03649),
        (3.9, 1.22733),
        (4.1, 1.28411),
        (10.0, 2.25175),
        (64.5, 4.15889),
        (130.0, 4.86368),
    ];

    /// Weight, mean (north, east) and precision (north north, north east, east east) of four components of
    /// [`scenes::three_walls`] after two rounds of scikit-learn 1.9.1, priors as in [`scenes`]: `m._initialize(X, resp)`
    /// with each point given to the nearest of `X[[0, 30, 60, 90]]`, then twice `_, r = m._e_step(X); m._m_step(X, r)`, and
    /// `degrees_of_freedom_ - 2`, `means_`, `inv(covariances_)`.
    const TWO_ROUNDS: [[f32; 6]; 4] = [
        [18.33953, 6.526653, 1.925904, 643.0592, -179.9019, 51.16996],
        [15.74546, 7.535833, 5.358467, 298.8206, -88.13354, 27.13393],
        [31.91035, 4.489528, 7.996644, 20.28277, 71.30945, 253.9736],
        [30.00467, 3.001361, -0.002566962, 0.3552481, 0.1077552, 395.0498],
    ];

    #[test]
    fn a_round_is_that_of_scikit_learn() {
        let points = scenes::three_walls();
        let mut mixture = Mixture::new();
        for point in &points {
            mixture.prior_mean_ned_m = mixture.prior_mean_ned_m.plus(point.times(1.0 / points.len() as f32));
        }
        let seeds = [0, 30, 60, 90].map(|index| points[index]);
        mixture.components.extend([Component::default(); 4]);
        for point in &points {
            let squared = |k: &usize| point.minus(seeds[*k]).norm_squared();
            let nearest = (0..4).min_by(|a, b| squared(a).total_cmp(&squared(b))).unwrap();
            mixture.components[nearest].moments.add(*point);
        }
        mixture.update(&PRIOR);
        for _ in 0..2 {
            mixture.observe(&points);
            mixture.maximise(&PRIOR);
        }
        for (component, [weight, north, east, nn, ne, ee]) in mixture.components.iter().zip(TWO_ROUNDS) {
            let away = component.mean_ned_m.minus(Horizontal { north, east });
            assert!((component.moments.count - weight).abs() < 2e-3, "{component:?} {weight}");
            assert!(away.norm() < 1e-3, "{component:?} {north} {east}");
            let [a, b, c] = component.form;
            let scale = nn + ee;
            for (ours, theirs) in [(2.0 * a, nn), (b, ne), (2.0 * c, ee)] {
                assert!((ours - theirs).abs() < 2e-3 * scale, "{component:?} {nn} {ne} {ee}");
            }
        }
    }

    #[test]
    fn the_digamma_function_is_that_of_scipy() {
        for (x, wanted) in DIGAMMA {
            assert!((digamma(x) - wanted).abs() < 5e-6 * (1.0 + wanted.abs()), "{x}: {} {wanted}", digamma(x));
        }
    }

    #[test]
    fn the_exponential_is_that_of_f64() {
        for k in 0..80_000 {
            let x = -1e-3 * k as f32;
            let wanted = f64::from(x).exp();
            assert!((f64::from(exp_below_zero(x)) / wanted - 1.0).abs() < 2e-5 * f64::from(1.0 - 0.1 * x), "{x}");
        }
        assert_eq!(exp_below_zero(0.0), 1.0);
    }

    #[test]
    fn the_work_is_bounded_and_every_point_is_in_some_component() {
        let mut mixture = Mixture::new();
        let mut rng = foxhound_core::base::rng::Rng::new(4, 4);
        for case in 0..200 {
            let scale = [1e-3, 1.0, 30.0, 1e4][case % 4];
            let points: std::vec::Vec<_> = (0..case % 129)
                .map(|_| Horizontal { north: scale * rng.gaussian(), east: scale * rng.gaussian() })
                .collect();
            mixture.cluster(&PRIOR, &points, &mut [0; POINTS_MAX]);
            let weight: f32 = mixture.components.iter().map(|component| component.moments.count).sum();
            assert!(mixture.work <= PRIOR.work_max, "{case}: {}", mixture.work);
            // Less what was in those that vanished last.
            assert!((points.len() as f32 - weight).abs() < 2.5, "{case}: {weight}");
        }
    }
}
