//! Policies that the page may run: built-in ones that touch nothing outside the simulation, and those named on the
//! command
//! line.

use genmanip_pipeline::PolicyFactory;
use genmanip_pipeline::policies::POLICIES;
use genmanip_workspace::WorkspaceError;
use serde::Serialize;

/// Policies that every user of the studio may run: they start no program, read no file and call no service.
const BUILTIN: [&str; 6] = ["expert", "agent", "clumsy", "blind", "random", "do_nothing"];

/// A policy that the page may run.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct OfferedPolicy {
    /// Name of the policy with arguments, e.g. `learned:policies/act`.
    pub policy: String,
    /// Description in one line.
    pub about: String,
}

/// All policies that the page may run. Others are refused, since they may start programs or cost money.
#[derive(Clone, Debug)]
pub struct OfferedPolicies(Vec<OfferedPolicy>);

impl OfferedPolicies {
    /// The policies named on the command line, followed by the built-in ones.
    ///
    /// # Errors
    /// For a name or an argument that no policy has.
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

    /// The policies in the order of the page's list.
    pub fn all(&self) -> &[OfferedPolicy] {
        &self.0
    }

    /// True if the page may run this policy, given with its arguments.
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
