//! Refuses managers that were replaced: of two that share a wall by a lease, the one with the
//! greater term leads.

use polyptych_protocol::ids::Term;

/// The greatest term of all managers that this process was connected to.
#[derive(Debug, Default)]
pub(crate) struct TermGuard {
    greatest: Term,
}

/// The reason why a manager is refused.
#[derive(Debug, PartialEq, Eq, thiserror::Error)]
#[error(
    "the manager there has term {offered}, and another one has led this server with term \
     {greatest}; end the manager there, or start this server again if the lease was begun anew"
)]
pub(crate) struct OldTerm {
    offered: Term,
    greatest: Term,
}

impl TermGuard {
    /// Admits a manager with the greatest term yet, and remembers it.
    ///
    /// # Errors
    /// A manager with a greater term was admitted before.
    pub fn admit(&mut self, offered: Term) -> Result<(), OldTerm> {
        let greatest = self.greatest;
        if offered < greatest {
            return Err(OldTerm { offered, greatest });
        }
        self.greatest = offered;
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn refuses_a_manager_that_was_replaced() {
        let mut guard = TermGuard::default();
        for term in [0, 0, 3, 3, 4] {
            assert_eq!(guard.admit(Term(term)), Ok(()));
        }
        for term in [0, 3] {
            let refused = guard.admit(Term(term)).expect_err("term 4 was there");
            assert!(refused.to_string().contains(&format!("term {term}, and")), "{refused}");
        }
        assert_eq!(guard.admit(Term(4)), Ok(()), "the same manager again");
    }
}
