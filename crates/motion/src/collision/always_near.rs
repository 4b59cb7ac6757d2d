//! Link pairs that are near by construction, as an SRDF lists them.

use genmanip_core::{RobotModel, Seed};
use rand::RngExt;

use super::body::bodies_closer_than;
use super::robot_shape::{RobotError, RobotShape};

/// Number of sampled configurations. Chosen by hand.
const SAMPLES: usize = 200;
/// Share of the sampled configurations at which a pair must be near; MoveIt's setup assistant uses the same.
const SHARE: f64 = 0.95;

/// Link pairs closer than `distance` (m) at nearly every configuration: a search could never keep them apart.
///
/// The first configuration is the home; the others are drawn from the joint ranges, always the same ones.
///
/// # Errors
/// Fails if kinematics or collision pieces are invalid.
pub fn always_near(robot: &RobotModel, distance: f64) -> Result<Vec<(usize, usize)>, RobotError> {
    let shape = RobotShape::without_tables(robot)?;
    let bodies = shape.bodies(None, 0.0);
    let mut candidates: Vec<_> = shape.body_pairs(&bodies, distance).into_iter().map(|pair| (pair, 0)).collect();
    let mut rng = Seed::new(0).fork("links that always touch").rng();
    let allowed_misses = ((1.0 - SHARE) * SAMPLES as f64).floor() as usize;
    for sample in 0..SAMPLES {
        let joints = shape.chain().joints().iter();
        let config: Vec<f64> = if sample == 0 {
            robot.home.clone()
        } else {
            joints.map(|joint| rng.random_range(joint.sampled())).collect()
        };
        let frames = shape.chain().frames(&config);
        candidates.retain_mut(|(pair, misses)| {
            let (a, b) = (&bodies[pair.first], &bodies[pair.second]);
            let [world_from_a, world_from_b] = [a, b].map(|body| frames[body.frame] * body.frame_from_body);
            let near = !a.ball.moved(&frames[a.frame]).is_apart(&b.ball.moved(&frames[b.frame]), distance)
                && bodies_closer_than(a, b, &world_from_a, &world_from_b, distance);
            *misses += usize::from(!near);
            *misses <= allowed_misses
        });
    }
    let link = |body: usize| match bodies[body].id {
        super::MovingBody::Link(link) => Some(link),
        super::MovingBody::Attached => None,
    };
    Ok(candidates.iter().filter_map(|(pair, _)| Some((link(pair.first)?, link(pair.second)?))).collect())
}
