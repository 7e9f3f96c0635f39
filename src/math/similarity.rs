//! Similarity transforms: rotation, uniform positive scale, translation.

use glam::{DMat3, DVec3};

/// x -> A x + t with A = s R, R a rotation, s > 0. Kept as the 3x4 matrix of the files, so that reading and writing
/// changes no bit; `scale` and `rotation` are derived from it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Similarity {
    rows: [[f32; 4]; 3],
}

/// How far A^T A may differ from s^2 I, relative to s^2: f32 files of composed transforms reach about 1e-5.
const SIMILARITY_TOLERANCE: f64 = 1e-3;

/// Why a matrix is no similarity. The text continues a sentence that begins with the matrix's name.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum SimilarityError {
    /// A value is infinite or no number.
    #[error("has a value that is not finite")]
    NotFinite,
    /// The matrix mirrors, or is flat in some direction.
    #[error("has determinant {determinant:.3e}: a similarity has a positive one (no mirroring, no zero scale)")]
    Determinant {
        /// Of the linear part.
        determinant: f64,
    },
    /// The matrix shears, or scales differently by direction.
    #[error("is not a rotation times a uniform scale")]
    NotUniform,
}

impl Similarity {
    /// The identity transform.
    pub const IDENTITY: Self = Self { rows: [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]] };

    /// From the rows of the 3x4 matrix (A | t).
    ///
    /// # Errors
    /// The text says why the matrix is not a similarity.
    pub fn from_rows(rows: [[f32; 4]; 3]) -> Result<Self, SimilarityError> {
        let out = Self { rows };
        if !rows.as_flattened().iter().all(|v| v.is_finite()) {
            return Err(SimilarityError::NotFinite);
        }
        let a = out.linear();
        let determinant = a.determinant();
        if determinant <= 0.0 {
            return Err(SimilarityError::Determinant { determinant });
        }
        let s2 = out.scale() * out.scale();
        let error = (a.transpose() * a - DMat3::from_diagonal(DVec3::splat(s2)))
            .to_cols_array()
            .iter()
            .fold(0.0, |m: f64, v| m.max(v.abs()));
        if error > SIMILARITY_TOLERANCE * s2 {
            return Err(SimilarityError::NotUniform);
        }
        Ok(out)
    }

    /// From a rotation, a scale > 0 and a translation, world units.
    pub fn from_parts(rotation: DMat3, scale: f64, translation: DVec3) -> Self {
        let a = rotation * scale;
        let row = |i: usize| [a.row(i).x as f32, a.row(i).y as f32, a.row(i).z as f32, translation[i] as f32];
        Self { rows: [row(0), row(1), row(2)] }
    }

    /// The rows of the 3x4 matrix (A | t).
    pub fn rows(&self) -> [[f32; 4]; 3] {
        self.rows
    }

    /// The linear part A = s R.
    pub fn linear(&self) -> DMat3 {
        let r = &self.rows;
        let col = |j: usize| DVec3::new(f64::from(r[0][j]), f64::from(r[1][j]), f64::from(r[2][j]));
        DMat3::from_cols(col(0), col(1), col(2))
    }

    /// The uniform scale s = det(A)^(1/3).
    pub fn scale(&self) -> f64 {
        self.linear().determinant().cbrt()
    }

    /// The rotation R = A / s.
    pub fn rotation(&self) -> DMat3 {
        self.linear() * (1.0 / self.scale())
    }

    /// The translation t, world units.
    pub fn translation(&self) -> DVec3 {
        DVec3::new(f64::from(self.rows[0][3]), f64::from(self.rows[1][3]), f64::from(self.rows[2][3]))
    }

    /// The transformed point A p + t.
    pub fn transform_point(&self, p: DVec3) -> DVec3 {
        self.linear() * p + self.translation()
    }

    /// The similarity that undoes this one.
    pub fn inverse(&self) -> Self {
        let linear = self.linear().inverse();
        Self::from_parts(linear, 1.0, -(linear * self.translation()))
    }

    /// The similarity that applies `first` and then this one.
    pub fn after(&self, first: &Self) -> Self {
        Self::from_parts(self.linear() * first.linear(), 1.0, self.transform_point(first.translation()))
    }
}
