//! The addresses of the managers that share a wall, of which one leads: a peer tries each in turn.

/// Maximum number of managers that share a wall: a standby for every machine room.
pub const MANAGERS_MAX: usize = 8;

/// Addresses of managers, and the one to try now.
#[derive(Clone, Debug)]
pub struct ManagerAddresses {
    all: Vec<String>,
    at: usize,
}

impl ManagerAddresses {
    /// The addresses of this list, separated by commas; a single address is a list of one.
    pub fn new(list: &str) -> Self {
        Self { all: list.split(',').map(|address| address.trim().to_owned()).collect(), at: 0 }
    }

    /// Returns the address to try now.
    pub fn current(&self) -> &str {
        &self.all[self.at]
    }

    /// Returns the place of the current address in the list, below [`len`](Self::len).
    pub fn index(&self) -> usize {
        self.at
    }

    /// Goes on to the next address, after the last to the first. Returns whether it is the first,
    /// so that all have been tried.
    pub fn advance(&mut self) -> bool {
        self.at = (self.at + 1) % self.all.len();
        self.at == 0
    }

    /// Returns the number of addresses, at least 1.
    #[expect(clippy::len_without_is_empty, reason = "there is always an address")]
    pub fn len(&self) -> usize {
        self.all.len()
    }

    /// Returns all addresses.
    pub fn all(&self) -> &[String] {
        &self.all
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_address_is_tried_in_turn() {
        let mut managers = ManagerAddresses::new("a:1, b:2,[::1]:3");
        let mut seen = Vec::new();
        for _ in 0..4 {
            seen.push(managers.current().to_owned());
            managers.advance();
        }
        assert_eq!(seen, ["a:1", "b:2", "[::1]:3", "a:1"]);
        assert_eq!([0, 1, 2].map(|_| managers.advance()), [false, true, false]);
        let mut single = ManagerAddresses::new("wall");
        assert!(single.advance() && single.current() == "wall");
    }
}
