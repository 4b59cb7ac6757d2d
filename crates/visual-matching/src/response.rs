//! Response of a camera from a colour chart, or from a surface of known colour.

use genmanip_core::CameraResponse;
use genmanip_real::least_squares::{Normal, minimise};

use crate::chart::reflectances;

/// Parameters of the fit: logarithms of the three gains, six entries of the matrix beside its diagonal, logarithms of
/// contrast and white level.
const SIZE: usize = 11;
/// Standard deviation of a patch's mean colour, sRGB 0-1, and of the parameters around their start: weak knowledge that
/// holds what a chart leaves open.
const PATCH_SD: f64 = 0.004;
const PRIOR_SD: [f64; SIZE] = [3.0, 3.0, 3.0, 0.15, 0.15, 0.15, 0.15, 0.15, 0.15, 0.35, 0.5];
/// Smallest linear display value of a patch's channel that is not taken as clipped: code 3.
const DARKEST: f64 = 9e-4;
/// Least number of patches for a fit.
const FEWEST: usize = 12;
/// Step of the numeric derivatives.
const STEP: f64 = 1e-5;

/// Response that maps the reflectances of the chart's patches to their linear display colours, and the root mean square
/// of the residuals in sRGB (0-1). The chart lies in the open, so that a white patch has the radiance 1.
///
/// `None` with fewer than 12 patches, or if no response fits.
pub fn from_chart(seen: &[Option<[f64; 3]>]) -> Option<(CameraResponse, f64)> {
    let known = reflectances();
    let pairs: Vec<([f64; 3], [f64; 3])> =
        known.into_iter().zip(seen).filter_map(|(known, seen)| Some((known, (*seen)?))).collect();
    if pairs.len() < FEWEST {
        return None;
    }
    let evaluate = |at: &Vec<f64>| {
        let mut normal = Normal::new(SIZE);
        let base = residuals(at, &pairs)?;
        let mut columns = Vec::with_capacity(SIZE);
        for index in 0..SIZE {
            let mut moved = at.clone();
            moved[index] += STEP;
            columns.push(residuals(&moved, &pairs)?);
        }
        for (row, residual) in base.iter().enumerate() {
            let slopes: Vec<(usize, f64)> =
                columns.iter().enumerate().map(|(index, column)| (index, (column[row] - residual) / STEP)).collect();
            normal.add(*residual, &slopes, 1.0);
        }
        for index in 0..SIZE {
            let residual = at[index] - start()[index];
            normal.add(residual, &[(index, 1.0)], (PATCH_SD / PRIOR_SD[index]).powi(2));
        }
        Some(normal)
    };
    let step = |at: &Vec<f64>, change: &[f64]| at.iter().zip(change).map(|(at, change)| at + change).collect();
    // Gains first: a start at the right brightness.
    let mut first = start();
    for (channel, gain) in first.iter_mut().enumerate().take(3) {
        let before: f64 = pairs.iter().map(|(before, _)| before[channel]).sum();
        let after: f64 = pairs.iter().map(|(_, after)| after[channel]).sum();
        *gain = (after / before).max(1e-3).ln();
    }
    let (found, _) = minimise(first, evaluate, step)?;
    let left = residuals(&found, &pairs)?;
    let rms = (left.iter().map(|value| value * value).sum::<f64>() / left.len() as f64).sqrt();
    Some((response(&found), rms))
}

/// Response with the gains that map a surface's linear base colour, in the open, to its mean linear display colour;
/// colour matrix and tone curve are those of an ideal camera.
pub fn from_color(base: [f64; 3], seen: [f64; 3]) -> CameraResponse {
    let gains = [0, 1, 2].map(|channel| (seen[channel] / base[channel].max(1e-3)).max(1e-3));
    with_gains(gains, CameraResponse::default())
}

/// The response with other gains, split into exposure and white balance.
pub fn with_gains(gains: [f64; 3], response: CameraResponse) -> CameraResponse {
    let exposure = luminance(gains);
    CameraResponse { exposure, white_balance: gains.map(|gain| gain / exposure), ..response }
}

/// Rec. 709 luminance of a linear colour.
pub fn luminance([red, green, blue]: [f64; 3]) -> f64 {
    0.2126 * red + 0.7152 * green + 0.0722 * blue
}

fn start() -> Vec<f64> {
    vec![0.0; SIZE]
}

fn response(at: &[f64]) -> CameraResponse {
    let [rg, rb, gr, gb, br, bg] = [at[3], at[4], at[5], at[6], at[7], at[8]];
    let matrix = [[1.0 - rg - rb, rg, rb], [gr, 1.0 - gr - gb, gb], [br, bg, 1.0 - br - bg]];
    let shape = CameraResponse { matrix, contrast: at[9].exp(), white: at[10].exp(), ..CameraResponse::default() };
    with_gains([at[0].exp(), at[1].exp(), at[2].exp()], shape)
}

/// Differences of expected and seen colours of the patches, in sRGB; `None` without a rising tone curve.
fn residuals(at: &[f64], pairs: &[([f64; 3], [f64; 3])]) -> Option<Vec<f64>> {
    let response = response(at);
    let (tone, gains) = (response.tone()?, response.gains());
    let mut out = Vec::with_capacity(3 * pairs.len());
    for (known, seen) in pairs {
        let light = [0, 1, 2].map(|channel| known[channel] * gains[channel]);
        for (row, seen) in response.matrix.iter().zip(seen) {
            let value: f64 = row.iter().zip(light).map(|(factor, light)| factor * light).sum();
            // A clipped channel says nothing, but the number of residuals is that of every evaluation.
            out.push(if *seen > DARKEST { encoded(tone.display(value)) - encoded(*seen) } else { 0.0 });
        }
    }
    out.iter().all(|value| value.is_finite()).then_some(out)
}

/// sRGB, 0-1, of a linear value.
fn encoded(linear: f64) -> f64 {
    if linear <= 0.003_130_8 { linear * 12.92 } else { 1.055 * linear.powf(1.0 / 2.4) - 0.055 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use genmanip_core::CameraResponse;

    /// A response is found again from the chart that it shows.
    #[test]
    fn a_chart_tells_the_response() {
        let matrix = [[1.08, -0.06, -0.02], [-0.03, 1.07, -0.04], [0.01, -0.09, 1.08]];
        for (gains, contrast, white) in [([1.2, 0.9, 0.7], 1.15, 1.4), ([0.6, 0.7, 0.8], 0.95, 1.1)] {
            let shape = CameraResponse { matrix, contrast, white, ..CameraResponse::default() };
            let truth = with_gains(gains, shape);
            let tone = truth.tone().expect("a curve that rises");
            let seen: Vec<Option<[f64; 3]>> = reflectances()
                .iter()
                .map(|known| {
                    let light: Vec<f64> = known.iter().zip(truth.gains()).map(|(known, gain)| known * gain).collect();
                    let shown = |row: [f64; 3]| tone.display(row.iter().zip(&light).map(|(a, b)| a * b).sum::<f64>());
                    Some(truth.matrix.map(shown))
                })
                .collect();
            let (found, rms) = from_chart(&seen).expect("a response");
            assert!(rms < 1e-3, "{rms}");
            for (found, true_) in found.gains().iter().zip(truth.gains()) {
                assert!((found / true_ - 1.0).abs() < 0.01, "{found} for {true_}");
            }
        }
        assert_eq!(from_chart(&[Some([0.5; 3]); 24][..10]), None, "too few patches");
    }
}
