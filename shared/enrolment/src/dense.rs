//! The dense layers, and how they are fitted: plain gradients, and Adam (Kingma and Ba 2015).

use hearing::LABELS;
use nalgebra::DMatrix;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// Steps of training; the rate falls to nothing in a line.
const STEPS: usize = 1200;
const RATE: f32 = 1e-3;
/// Of each batch, windows of the user's and of the rehearsal.
const BATCH: (usize, usize) = (64, 192);
/// So much of a label's share goes to all labels alike: nobody is to be too sure.
const SMOOTHING: f32 = 0.05;
const BETA: (f32, f32) = (0.9, 0.999);
const EPSILON: f32 = 1e-8;

/// Windows as the convolutions see them, with what was said.
#[derive(Debug, Clone, PartialEq)]
pub struct Features {
    flat: usize,
    labels: Vec<usize>,
    /// One window after another.
    numbers: Vec<f32>,
}

impl Features {
    /// None yet, each of so many numbers.
    #[must_use]
    pub fn new(flat: usize) -> Self {
        Self { flat, labels: Vec::new(), numbers: Vec::new() }
    }

    /// Adds a window; one of another length is cut or filled up.
    pub fn push(&mut self, label: usize, numbers: &[f32]) {
        self.labels.push(label.min(LABELS.len() - 1));
        self.numbers.extend(numbers.iter().take(self.flat));
        self.numbers.resize(self.labels.len() * self.flat, 0.0);
    }

    /// All of them together.
    #[must_use]
    pub fn joined<'a>(flat: usize, parts: impl Iterator<Item = &'a Self>) -> Self {
        let mut all = Self::new(flat);
        for part in parts {
            all.labels.extend(&part.labels);
            all.numbers.extend(&part.numbers);
        }
        all
    }

    /// How many there are.
    #[must_use]
    pub fn len(&self) -> usize {
        self.labels.len()
    }

    /// Whether there is none.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.labels.is_empty()
    }

    /// Numbers of a window.
    #[must_use]
    pub fn flat(&self) -> usize {
        self.flat
    }

    /// What was said in each.
    pub(crate) fn labels(&self) -> &[usize] {
        &self.labels
    }

    /// A window a column.
    fn matrix(&self) -> DMatrix<f32> {
        DMatrix::from_column_slice(self.flat, self.len(), &self.numbers)
    }

    fn window(&self, at: usize) -> &[f32] {
        &self.numbers[at * self.flat..][..self.flat]
    }
}

/// Two layers: of the convolutions' numbers to hidden ones, and of these to labels.
#[derive(Debug, Clone, PartialEq)]
pub struct Dense {
    /// Weights of the first layer, hidden by flat.
    pub w1: DMatrix<f32>,
    /// Biases of the first layer, a column.
    pub b1: DMatrix<f32>,
    /// Weights of the second layer, labels by hidden.
    pub w2: DMatrix<f32>,
    /// Biases of the second layer, a column.
    pub b2: DMatrix<f32>,
}

impl Dense {
    /// Trained further by the user's windows and their labels, and by what these layers themselves make of the
    /// rehearsal: they stay as unsure of others as they are. The same seed gives the same; where there is nothing of
    /// the user's, nothing changes.
    #[must_use]
    pub fn fitted(&self, user: &Features, rehearsal: &Features, seed: u64) -> Self {
        let mut dense = self.clone();
        if user.is_empty() || rehearsal.is_empty() {
            return dense;
        }
        let mut dice = ChaCha8Rng::seed_from_u64(seed);
        let mut moments = Moments::of(self);
        let (said, known) = (targets(&user.labels), self.probabilities(&rehearsal.matrix()).0);
        for step in 0..STEPS {
            let (mut seen, mut targets) = (Vec::new(), Vec::new());
            for (features, wanted, count) in [(user, &said, BATCH.0), (rehearsal, &known, BATCH.1)] {
                for _ in 0..count {
                    let at = dice.random_range(0..features.len());
                    seen.extend_from_slice(features.window(at));
                    targets.extend(wanted.column(at).iter());
                }
            }
            let windows = BATCH.0 + BATCH.1;
            let seen = DMatrix::from_vec(user.flat, windows, seen);
            let (found, _) = dense.gradients(&seen, &DMatrix::from_vec(LABELS.len(), windows, targets));
            moments.update(&mut dense, &found, RATE * (1.0 - step as f32 / STEPS as f32));
        }
        dense
    }

    /// The cue that each window is taken for, if it is as probable as it has to be, and more than all else.
    pub(crate) fn sure(&self, features: &Features, least: &dyn Fn(usize) -> f32) -> Vec<Option<usize>> {
        let (p, _) = self.probabilities(&features.matrix());
        let best = p.column_iter().map(|column| (column.imax(), column.max()));
        best.map(|(word, p)| (word < LABELS.len() - 1 && p >= least(word)).then_some(word)).collect()
    }

    /// Probabilities of the labels, and the hidden numbers, of windows in columns.
    fn probabilities(&self, seen: &DMatrix<f32>) -> (DMatrix<f32>, DMatrix<f32>) {
        let layer = |weights: &DMatrix<f32>, biases: &DMatrix<f32>, seen: &DMatrix<f32>| {
            let mut made = weights * seen;
            made.column_iter_mut().for_each(|mut column| column += biases.column(0));
            made
        };
        let hidden = layer(&self.w1, &self.b1, seen).map(|x| x.max(0.0));
        let mut p = layer(&self.w2, &self.b2, &hidden);
        for mut column in p.column_iter_mut() {
            let highest = column.max();
            column.apply(|x| *x = (*x - highest).exp());
            let sum = column.sum();
            column /= sum;
        }
        (p, hidden)
    }

    /// Gradients of the mean cross-entropy by the layers' numbers, and the entropy itself.
    fn gradients(&self, seen: &DMatrix<f32>, targets: &DMatrix<f32>) -> (Self, f32) {
        let (p, hidden) = self.probabilities(seen);
        let windows = seen.ncols() as f32;
        let entropy = -targets.zip_map(&p, |t, p| t * p.max(1e-9).ln()).sum() / windows;
        let logits = (p - targets) / windows;
        let below = self.w2.tr_mul(&logits).zip_map(&hidden, |g, h| if h > 0.0 { g } else { 0.0 });
        let column = |m: &DMatrix<f32>| DMatrix::from_column_slice(m.nrows(), 1, m.column_sum().as_slice());
        let found = Self {
            w1: &below * seen.transpose(),
            b1: column(&below),
            w2: &logits * hidden.transpose(),
            b2: column(&logits),
        };
        (found, entropy)
    }

    fn parts(&self) -> [&DMatrix<f32>; 4] {
        [&self.w1, &self.b1, &self.w2, &self.b2]
    }

    fn parts_mut(&mut self) -> [&mut DMatrix<f32>; 4] {
        [&mut self.w1, &mut self.b1, &mut self.w2, &mut self.b2]
    }
}

/// What is to come of windows in which this was said, in columns.
fn targets(said: &[usize]) -> DMatrix<f32> {
    let each = SMOOTHING / LABELS.len() as f32;
    DMatrix::from_fn(LABELS.len(), said.len(), |label, window| {
        each + if said[window] == label { 1.0 - SMOOTHING } else { 0.0 }
    })
}

/// Adam's running means of gradients and of their squares.
struct Moments {
    step: i32,
    first: Dense,
    second: Dense,
}

impl Moments {
    fn of(dense: &Dense) -> Self {
        let zeros = |m: &DMatrix<f32>| DMatrix::zeros(m.nrows(), m.ncols());
        let none = Dense { w1: zeros(&dense.w1), b1: zeros(&dense.b1), w2: zeros(&dense.w2), b2: zeros(&dense.b2) };
        Self { step: 0, first: none.clone(), second: none }
    }

    fn update(&mut self, dense: &mut Dense, found: &Dense, rate: f32) {
        self.step += 1;
        let unbiased = (1.0 - BETA.0.powi(self.step), 1.0 - BETA.1.powi(self.step));
        let moments = self.first.parts_mut().into_iter().zip(self.second.parts_mut());
        for ((numbers, found), (first, second)) in dense.parts_mut().into_iter().zip(found.parts()).zip(moments) {
            first.zip_apply(found, |m, g| *m += (1.0 - BETA.0) * (g - *m));
            second.zip_apply(found, |m, g| *m += (1.0 - BETA.1) * (g * g - *m));
            let moments = first.iter().zip(second.iter());
            for (number, (first, second)) in numbers.iter_mut().zip(moments) {
                *number -= rate * (first / unbiased.0) / ((second / unbiased.1).sqrt() + EPSILON);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::{Dense, Features, targets};
    use nalgebra::DMatrix;

    /// Numbers that look random.
    fn some(rows: usize, columns: usize, salt: f32) -> DMatrix<f32> {
        DMatrix::from_fn(rows, columns, |i, k| (salt + 12.9898 * i as f32 + 78.233 * k as f32).sin() * 0.7)
    }

    fn small() -> Dense {
        Dense { w1: some(24, 8, 0.1), b1: some(24, 1, 0.2), w2: some(6, 24, 0.3), b2: some(6, 1, 0.4) }
    }

    #[test]
    fn gradients_are_those_of_the_cross_entropy() {
        let (dense, seen, targets) = (small(), some(8, 7, 0.5), targets(&[0, 1, 2, 3, 4, 0, 1]));
        let (found, _) = dense.gradients(&seen, &targets);
        let found = found.parts().map(Clone::clone);
        for (part, found) in found.iter().enumerate() {
            for (at, expected) in found.iter().enumerate() {
                let entropy = |by: f32| {
                    let mut moved = dense.clone();
                    moved.parts_mut()[part][at] += by;
                    moved.gradients(&seen, &targets).1
                };
                let slope = (entropy(1e-3) - entropy(-1e-3)) / 2e-3;
                assert!((slope - expected).abs() < 4e-3, "part {part}, number {at}: {slope}, not {expected}");
            }
        }
    }

    #[test]
    fn a_voice_is_learnt_and_what_was_known_stays() {
        // What is known: label 4 where the first number is high. What the user says is label 1, where the second is.
        let (mut user, mut rehearsal) = (Features::new(8), Features::new(8));
        for i in 0..200 {
            let noise = some(8, 1, i as f32);
            let high = |at: usize| (0..8).map(|k| noise[k] * 0.2 + if k == at { 4.0 } else { 0.0 }).collect::<Vec<_>>();
            user.push(1, &high(1));
            rehearsal.push(4, &high(0));
        }
        let fitted = small().fitted(&user, &rehearsal, 1);
        for (features, label) in [(&user, 1), (&rehearsal, 4)] {
            let of = |dense: &Dense| dense.probabilities(&features.matrix()).0.row(label).min();
            let (before, after) = (of(&small()), of(&fitted));
            assert!(if label == 1 { after > 0.6 } else { (after - before).abs() < 0.1 }, "{label}: {before} {after}");
        }
        assert_eq!(fitted, small().fitted(&user, &rehearsal, 1), "the same seed gives the same");
        assert_eq!(small().fitted(&Features::new(8), &rehearsal, 1), small(), "nobody said anything");
    }
}
