//! Rotations as the index of the largest component of a unit quaternion, and the other three.

/// What a quaternion (w, x, y, z) is multiplied by to have length 1 and a positive largest component; `None` if it is zero
/// or not finite.
pub fn normal_scale(quat: &[f32; 4]) -> Option<f64> {
    let q = quat.map(f64::from);
    let length = q.iter().map(|v| v * v).sum::<f64>().sqrt();
    (length.is_finite() && length > 0.0).then(|| q[largest(&q)].signum() / length)
}

/// Index of the largest component, and the other three of the unit quaternion in which it is positive; `None` for a
/// quaternion that is zero or not finite.
pub fn smallest_three(quat: &[f32; 4]) -> Option<(usize, [f32; 3])> {
    let scale = normal_scale(quat)?;
    let q = quat.map(f64::from);
    let largest = largest(&q);
    let mut rest = (0..4).filter(|&i| i != largest).map(|i| (q[i] * scale) as f32);
    Some((largest, std::array::from_fn(|_| rest.next().unwrap_or_default())))
}

/// The inverse of [`smallest_three`]; `None` if there is no such component. The largest one is at least 1/2: other components
/// that rounding has made too large for that are shortened.
pub fn whole_quat(index: usize, rest: [f32; 3]) -> Option<[f32; 4]> {
    const MOST_SQUARES: f64 = 0.75;
    let squares = rest.map(|v| f64::from(v).powi(2)).iter().sum::<f64>();
    let shorter = if squares > MOST_SQUARES { (MOST_SQUARES / squares).sqrt() } else { 1.0 };
    let largest = (1.0 - squares.min(MOST_SQUARES)).sqrt() as f32;
    let mut rest = rest.map(|v| (f64::from(v) * shorter) as f32).into_iter();
    (index < 4 && squares.is_finite())
        .then(|| std::array::from_fn(|k| if k == index { largest } else { rest.next().unwrap_or_default() }))
}

/// Index of the component of the largest magnitude; the last one of several.
fn largest(q: &[f64; 4]) -> usize {
    (0..4).max_by(|&a, &b| q[a].abs().total_cmp(&q[b].abs())).unwrap_or(0)
}
