//! Policies that the page may run: those that touch nothing outside of the simulation, and those that the command line
//! names.

use genmanip_pipeline::PolicyFactory;
use genmanip_pipeline::policies::POLICIES;
use genmanip_workspace::WorkspaceError;
use serde::Serialize;

/// Policies that anyone who reaches the studio may run: they start no program, read no file and ask no service.
const BUILTIN: [&str; 6] = ["expert", "agent", "clumsy", "blind", "random", "do_nothing"];

/// A policy that the page offers.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct OfferedPolicy {
    /// Name with arguments, e.g. `learned:policies/act`.
    pub policy: String,
    /// One-line description.
    pub about: String,
}

/// All policies that the page offers; others are refused, since they may run programs and cost money.
#[derive(Clone, Debug)]
pub struct OfferedPolicies(Vec<OfferedPolicy>);

impl OfferedPolicies {
    /// The built-in ones after those that are named, as on the command line.
    ///
    /// # Errors
    /// A name or an argument that no policy has.
    pub fn new(named: &[String]) -> Result<Self, WorkspaceError> {
        let mut offered = Vec::new();
        for text in named {
            PolicyFactory::resolve(text)?;
            offered.push(text.as_str());
        }
        let others = BUILTIN.into_iter().filter(|name| !named.iter().any(|text| text == name));
        let about = |text: &str| {
            let name = text.split(':').next().unwrap_or(text);
            POLICIES.iter().find(|entry| entry.name == name).map_or("", |entry| entry.about)
        };
        offered.extend(others);
        let offered =
            offered.iter().map(|text| OfferedPolicy { policy: (*text).to_owned(), about: about(text).to_owned() });
        Ok(Self(offered.collect()))
    }

    /// The policies in the order in which they are listed.
    pub fn all(&self) -> &[OfferedPolicy] {
        &self.0
    }

    /// True if a policy may be run.
    pub fn has(&self, policy: &str) -> bool {
        self.0.iter().any(|offered| offered.policy == policy)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_what_is_named_reaches_programs_and_services() {
        let builtin = OfferedPolicies::new(&[]).unwrap();
        assert!(builtin.has("expert") && builtin.all().iter().all(|offered| !offered.about.is_empty()));
        for policy in ["python:os:system", "openpi", "learned:.", "agent:vlm=models.toml", "random:seconds=500", ""] {
            assert!(!builtin.has(policy), "{policy}");
        }
        let named = OfferedPolicies::new(&["random:seconds=5".into(), "expert".into()]).unwrap();
        assert_eq!(named.all()[0].policy, "random:seconds=5");
        assert_eq!(named.all().iter().filter(|offered| offered.policy == "expert").count(), 1);
        assert!(OfferedPolicies::new(&["exprt".into()]).is_err());
        assert!(OfferedPolicies::new(&["random:second=5".into()]).is_err());
    }
}
