//! Key light and ambient light from the shadows of known bodies on the table.
//!
//! In a scene whose table gets the share V of the key light and A of the ambient light, relative to a table in the open,
//! a pixel is brightened by S = κ V + (1 − κ) A, with κ the key light's part of the light on the open table. V and A are
//! rendered. Two photographs, with and without objects, give the ratio of two such S, in which the table's texture
//! cancels; one photograph gives S times an unknown constant, with the texture as noise. Direction and angular radius are
//! searched; κ is the best one for each candidate.

use genmanip_core::glam::DVec3;
use glam::Vec3A;

use crate::error::MatchError;
use crate::scene::{KeyLight, SeenScene, Shares};

/// Residual beyond which a pixel counts less and less, relative to a table in the open: texture and gloss.
const OUTLIER: f64 = 0.12;
/// Largest number of pixels per photograph; chosen for speed.
const PIXELS: usize = 6_000;
/// Elevations of the coarse search, degrees, and candidates around each.
const ELEVATIONS: [(f64, usize); 5] = [(22.0, 16), (38.0, 16), (54.0, 14), (69.0, 10), (82.0, 6)];
/// Angular radius of the coarse search, rad, and limits of the fine one.
const RADIUS_RAD: f64 = 0.06;
const RADII_RAD: [f64; 2] = [0.004, 0.35];
/// Lowest elevation of the key light, sine.
const LOWEST: f64 = 0.15;
/// First step of the search at a lower resolution, first and last step of the fine one, degrees.
const STEPS_DEG: [f64; 3] = [8.0, 2.0, 0.4];
/// Number of neighbouring pixels whose residuals are taken as one: texture and rendering errors are correlated.
const CORRELATED: f64 = 40.0;
/// Largest standard deviation of a direction that counts as identified, degrees, and smallest part of the key light.
const WIDEST_DEG: f64 = 4.0;
const FAINTEST: f64 = 0.06;

/// Photograph of a scene that shadows the table, with what it is compared with.
pub struct Observation {
    scene: SeenScene,
    /// The same view without the objects; `None` if the table is then in the open, or unknown.
    before: Option<SeenScene>,
    /// Pixels that are compared.
    pixels: Vec<usize>,
    /// Their ratios to the photograph without objects, or their radiance.
    values: Vec<Vec3A>,
    /// True if `values` are radiances of a table of unknown colour.
    is_unknown: bool,
    /// True if the camera's response is known, so that the contrast of shadows can be trusted.
    pub is_calibrated: bool,
}

/// The estimated light.
#[derive(Clone, Debug, PartialEq)]
pub struct LightEstimate {
    /// Key light.
    pub light: KeyLight,
    /// Part of the key light in the light on the open table, by channel.
    pub part: [f64; 3],
    /// Standard deviation of the direction, degrees; infinite if the shadows do not tell it.
    pub direction_sd_deg: f64,
    /// True if the width of penumbrae tells the angular radius.
    pub has_radius: bool,
}

impl LightEstimate {
    /// True if shadows tell the direction.
    pub fn has_direction(&self) -> bool {
        self.direction_sd_deg <= WIDEST_DEG && self.part.iter().sum::<f64>() / 3.0 >= FAINTEST
    }
}

impl Observation {
    /// Radiances of a scene before which no photograph was taken; the table has an unknown, even colour.
    pub fn alone(scene: SeenScene, radiance: &[Vec3A], is_usable: &[bool], is_calibrated: bool) -> Self {
        let pixels = chosen(&scene, None, is_usable);
        let values = pixels.iter().map(|&at| radiance[at]).collect();
        Self { scene, before: None, pixels, values, is_unknown: true, is_calibrated }
    }

    /// Radiances of a scene with objects, and those without (`before`); `before_scene` is what then shadows the table,
    /// `None` for nothing.
    pub fn pair(
        scene: SeenScene,
        before_scene: Option<SeenScene>,
        [after, before]: [&[Vec3A]; 2],
        is_usable: &[bool],
        is_calibrated: bool,
    ) -> Self {
        let pixels = chosen(&scene, before_scene.as_ref(), is_usable);
        let values = pixels.iter().map(|&at| after[at] / before[at].max(Vec3A::splat(1e-4))).collect();
        Self { scene, before: before_scene, pixels, values, is_unknown: false, is_calibrated }
    }

    fn lit(&self, light: &KeyLight) -> Result<Lit<'_>, MatchError> {
        let pick = |shares: &Shares| -> Vec<[f64; 2]> {
            self.pixels.iter().map(|&at| [f64::from(shares.key[at]), f64::from(shares.ambient[at])]).collect()
        };
        let after = pick(&self.scene.shares(light)?);
        let before = self.before.as_ref().map(|scene| scene.shares(light).map(|shares| pick(&shares))).transpose()?;
        Ok(Lit { observation: self, after, before })
    }
}

/// An observation under a candidate light.
struct Lit<'a> {
    observation: &'a Observation,
    /// Shares of key and ambient light at the compared pixels.
    after: Vec<[f64; 2]>,
    before: Option<Vec<[f64; 2]>>,
}

impl Lit<'_> {
    /// Robust cost of a part of the key light; `value` reads the compared value of a pixel.
    fn cost(&self, part: f64, value: &dyn Fn(Vec3A) -> f64) -> f64 {
        let mixed = |[key, ambient]: [f64; 2]| part * key + (1.0 - part) * ambient;
        let values = self.observation.values.iter().map(|&it| value(it));
        let scale = if self.observation.is_unknown {
            let (mut top, mut bottom) = (0.0, 0.0);
            for (value, &after) in values.clone().zip(&self.after) {
                let expected = mixed(after);
                (top, bottom) = (top + value * expected, bottom + expected * expected);
            }
            (top / f64::max(bottom, 1e-12)).max(1e-9)
        } else {
            1.0
        };
        values
            .enumerate()
            .map(|(index, value)| {
                let before = self.before.as_ref().map_or(1.0, |before| mixed(before[index]));
                let residual = (value / scale * before - mixed(self.after[index])) / OUTLIER;
                OUTLIER * OUTLIER * (residual * residual).ln_1p()
            })
            .sum()
    }
}

/// Light that explains the observations best; `coarse` are the same ones at a lower resolution, for the first search.
/// `None` without any compared pixel.
///
/// # Errors
/// When a camera cannot be rendered.
pub fn estimate(coarse: &[Observation], fine: &[Observation]) -> Result<Option<LightEstimate>, MatchError> {
    let count: usize = fine.iter().map(|observation| observation.pixels.len()).sum();
    if count == 0 {
        return Ok(None);
    }
    let coarse_cost = |light: &KeyLight| cost_of(coarse, light);
    let cost_of = |light: &KeyLight| cost_of(fine, light);
    let mut best: Vec<(f64, KeyLight)> = Vec::new();
    for (elevation, around) in ELEVATIONS {
        for index in 0..around {
            let azimuth = std::f64::consts::TAU * (index as f64 + 0.5 * (elevation / 16.0)) / around as f64;
            let (sine, cosine) = elevation.to_radians().sin_cos();
            let direction = DVec3::new(azimuth.cos() * cosine, azimuth.sin() * cosine, sine);
            let light = KeyLight { direction, radius_rad: RADIUS_RAD };
            best.push((coarse_cost(&light)?, light));
        }
    }
    best.sort_by(|a, b| a.0.total_cmp(&b.0));
    best.truncate(3);
    for entry in &mut best {
        *entry = refined(*entry, [STEPS_DEG[0], STEPS_DEG[1]], &coarse_cost)?;
    }
    best.sort_by(|a, b| a.0.total_cmp(&b.0));
    let start = best[0].1;
    let (cost, light) = refined((cost_of(&start)?, start), [STEPS_DEG[1], STEPS_DEG[2]], &cost_of)?;
    // The contrast of shadows depends on the tone curve: only cameras whose curve is known tell it, if there are any.
    let trusted: Vec<&Observation> = match fine.iter().any(|it| it.is_calibrated) {
        true => fine.iter().filter(|it| it.is_calibrated).collect(),
        false => fine.iter().collect(),
    };
    let lit = trusted.into_iter().map(|observation| observation.lit(&light)).collect::<Result<Vec<_>, _>>()?;
    let part = [0, 1, 2].map(|channel| best_part(&lit, &|color: Vec3A| f64::from(color[channel])).0);
    let noise = CORRELATED * cost / count as f64;
    let direction_sd_deg = direction_sd(&light, cost, noise, &cost_of)?;
    let wider = |factor: f64| KeyLight { radius_rad: (light.radius_rad * factor).clamp(RADII_RAD[0], 0.5), ..light };
    let worse = f64::min(cost_of(&wider(2.5))?, cost_of(&wider(0.4))?) - cost;
    Ok(Some(LightEstimate { light, part, direction_sd_deg, has_radius: worse > noise }))
}

/// Cost of a candidate light with its best part of the key light, over grey values.
fn cost_of(observations: &[Observation], light: &KeyLight) -> Result<f64, MatchError> {
    let lit = observations.iter().map(|observation| observation.lit(light)).collect::<Result<Vec<_>, _>>()?;
    Ok(best_part(&lit, &|color: Vec3A| f64::from(color.element_sum() / 3.0)).1)
}

/// Compass search over direction and angular radius, with steps between two lengths (degrees).
fn refined(
    (mut cost, mut light): (f64, KeyLight),
    [first, last]: [f64; 2],
    cost_of: &dyn Fn(&KeyLight) -> Result<f64, MatchError>,
) -> Result<(f64, KeyLight), MatchError> {
    let mut step = first;
    while step >= last {
        let [east, north] = tangents(light.direction);
        let turned = |axis: DVec3, degrees: f64| {
            let direction = (light.direction + axis * degrees.to_radians().tan()).normalize();
            KeyLight { direction: raised(direction), ..light }
        };
        let scale = 1.0 + step / 9.0;
        let radius = |factor: f64| {
            let radius_rad = (light.radius_rad * factor).clamp(RADII_RAD[0], RADII_RAD[1]);
            KeyLight { radius_rad, ..light }
        };
        let tried = [
            turned(east, step),
            turned(east, -step),
            turned(north, step),
            turned(north, -step),
            radius(scale),
            radius(1.0 / scale),
        ];
        let mut found = (cost, light);
        for light in tried {
            let cost = cost_of(&light)?;
            if cost < found.0 {
                found = (cost, light);
            }
        }
        if found.0 < cost {
            (cost, light) = found;
        } else {
            step *= 0.5;
        }
    }
    Ok((cost, light))
}

/// Standard deviation of the direction (degrees), along the less certain of two perpendicular turns, from the curvature
/// of the cost.
fn direction_sd(
    light: &KeyLight,
    cost: f64,
    noise: f64,
    cost_of: &dyn Fn(&KeyLight) -> Result<f64, MatchError>,
) -> Result<f64, MatchError> {
    const TURN_DEG: f64 = 3.0;
    let mut widest = 0.0_f64;
    for axis in tangents(light.direction) {
        let mut rise = f64::INFINITY;
        for side in [-1.0, 1.0] {
            let direction = (light.direction + axis * side * TURN_DEG.to_radians().tan()).normalize();
            rise = rise.min(cost_of(&KeyLight { direction: raised(direction), ..*light })? - cost);
        }
        let sd = if rise > 0.0 { TURN_DEG * (noise / rise).sqrt() } else { f64::INFINITY };
        widest = widest.max(sd);
    }
    Ok(widest)
}

/// Two unit vectors perpendicular to a direction and to each other.
fn tangents(direction: DVec3) -> [DVec3; 2] {
    let east = direction.any_orthonormal_vector();
    [east, direction.cross(east)]
}

/// The direction, not lower than the lowest elevation.
fn raised(direction: DVec3) -> DVec3 {
    DVec3::new(direction.x, direction.y, direction.z.max(LOWEST)).normalize()
}

/// Part of the key light with the smallest cost, and that cost: the best of evenly spaced ones, since the robust cost has
/// several minima, then golden-section search around it.
fn best_part(lit: &[Lit<'_>], value: &dyn Fn(Vec3A) -> f64) -> (f64, f64) {
    const RATIO: f64 = 0.618_033_988_75;
    const STEPS: usize = 8;
    // Some light always comes from around.
    const MOST: f64 = 0.9;
    let cost = |part: f64| lit.iter().map(|lit| lit.cost(part, value)).sum::<f64>();
    let spaced = (0..=STEPS).map(|step| MOST * step as f64 / STEPS as f64).map(|part| (cost(part), part));
    let (_, middle) = spaced.min_by(|a, b| a.0.total_cmp(&b.0)).unwrap_or_default();
    let reach = MOST / STEPS as f64;
    let (mut low, mut high) = ((middle - reach).max(0.0), (middle + reach).min(MOST));
    let (mut a, mut b) = (high - RATIO * (high - low), low + RATIO * (high - low));
    let (mut cost_a, mut cost_b) = (cost(a), cost(b));
    for _ in 0..6 {
        if cost_a < cost_b {
            (high, b, cost_b) = (b, a, cost_a);
            a = high - RATIO * (high - low);
            cost_a = cost(a);
        } else {
            (low, a, cost_a) = (a, b, cost_b);
            b = low + RATIO * (high - low);
            cost_b = cost(b);
        }
    }
    let part = 0.5 * (low + high);
    (part, cost(part))
}

/// Pixels to compare: of the table in both scenes, usable, and not too many.
fn chosen(scene: &SeenScene, before: Option<&SeenScene>, is_usable: &[bool]) -> Vec<usize> {
    let fits = |at: &usize| scene.is_table[*at] && is_usable[*at] && before.is_none_or(|scene| scene.is_table[*at]);
    let all: Vec<usize> = (0..scene.is_table.len()).filter(fits).collect();
    let step = all.len().div_ceil(PIXELS).max(1);
    all.into_iter().step_by(step).collect()
}
