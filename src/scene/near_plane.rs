//! Where a scene's pictures begin.

/// Depth of the near plane, scene units: no splat whose centre is before it is drawn. A scene is drawn with that of its training, as
/// scenes have any unit: where cameras are closer than the usual one, nothing would be seen.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NearPlane(pub f32);

impl Default for NearPlane {
    /// That of 3DGS.
    fn default() -> Self {
        Self(0.2)
    }
}

impl NearPlane {
    /// True if the depth is one that pictures can begin at.
    pub fn is_valid(self) -> bool {
        self.0.is_finite() && self.0 >= 0.0
    }
}
