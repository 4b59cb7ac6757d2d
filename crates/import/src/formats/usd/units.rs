//! Units of a stage.

/// Units of length and mass of a stage.
#[derive(Clone, Copy, Debug)]
pub struct Units {
    /// Metres per unit.
    pub metres: f64,
    /// Kilograms per unit.
    pub kilograms: f64,
}

impl Units {
    /// Density in kg/m³ from one in these units.
    pub fn density(self, stated: f64) -> f64 {
        stated * self.kilograms / self.metres.powi(3)
    }
}
