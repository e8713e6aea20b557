//! Transactions that wait until the files that they bring are read, and those that must not go
//! ahead of them: later ones of the same client that change the same node, material, layer or
//! variant. No other waits, so that a long import does not hold up what a program shows meanwhile.

use std::collections::BTreeSet;

use polyptych_core::{ClientRequest, EditTarget, SessionId};
use polyptych_protocol::ids::Revision;
use polyptych_protocol::transaction::Transaction;

/// The number of a transaction that waits. None is given twice.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Ticket(u64);

/// Transactions that wait, in the order in which they came. `T` is what is done with one in its
/// turn.
#[derive(Debug)]
pub(super) struct TransactionQueue<T> {
    waiting: Vec<Waiting<T>>,
    last: u64,
}

/// A transaction that waits.
#[derive(Debug)]
struct Waiting<T> {
    ticket: Ticket,
    job: ClientRequest,
    /// The parts of the scene that it changes.
    targets: BTreeSet<EditTarget>,
    /// The state in which the scene was opened that it is for.
    scene: Revision,
    /// `None` while its files are read.
    ready: Option<T>,
}

/// A transaction whose turn has come.
#[derive(Debug, PartialEq)]
pub(super) struct Turn<T> {
    pub job: ClientRequest,
    /// The state in which the scene was opened that it is for.
    pub scene: Revision,
    pub ready: T,
}

/// Returns the parts of the open scene that a transaction changes. What it makes itself has no
/// number yet, so that no other one can name it.
fn targets(transaction: &Transaction) -> impl Iterator<Item = EditTarget> {
    transaction.edits.iter().filter_map(EditTarget::of).filter(|target| match target {
        EditTarget::Node(node) => node.provisional_index().is_none(),
        _ => true,
    })
}

impl<T> TransactionQueue<T> {
    pub fn new() -> Self {
        Self { waiting: Vec::new(), last: 0 }
    }

    /// Returns whether a transaction without files must not go ahead of one that waits.
    pub fn holds(&self, client: SessionId, transaction: &Transaction) -> bool {
        let mut own = self.waiting.iter().filter(|one| one.job.client == client).peekable();
        own.peek().is_some() && {
            let targets: BTreeSet<EditTarget> = targets(transaction).collect();
            own.any(|one| !one.targets.is_disjoint(&targets))
        }
    }

    /// Lets a transaction wait whose files are read; [`set_ready`](Self::set_ready) says when they
    /// are.
    pub fn add_reading(
        &mut self,
        job: ClientRequest,
        scene: Revision,
        transaction: &Transaction,
    ) -> Ticket {
        self.add(job, scene, transaction, None)
    }

    /// Lets a transaction without files wait that the queue [holds](Self::holds).
    pub fn add_held(
        &mut self,
        job: ClientRequest,
        scene: Revision,
        transaction: &Transaction,
        ready: T,
    ) {
        self.add(job, scene, transaction, Some(ready));
    }

    fn add(
        &mut self,
        job: ClientRequest,
        scene: Revision,
        transaction: &Transaction,
        ready: Option<T>,
    ) -> Ticket {
        self.last += 1;
        let ticket = Ticket(self.last);
        let targets = targets(transaction).collect();
        self.waiting.push(Waiting { ticket, job, targets, scene, ready });
        ticket
    }

    /// The files of a transaction were read, or could not be. One that is forgotten stays so.
    pub fn set_ready(&mut self, ticket: Ticket, ready: T) {
        if let Some(one) = self.waiting.iter_mut().find(|one| one.ticket == ticket) {
            one.ready = Some(ready);
        }
    }

    /// Takes a transaction of this client out that waits for nothing any more.
    pub fn pop(&mut self, client: SessionId) -> Option<Turn<T>> {
        let may_go = |at: &usize| {
            let (earlier, one) = (&self.waiting[..*at], &self.waiting[*at]);
            let is_ready = one.job.client == client && one.ready.is_some();
            is_ready && !earlier.iter().any(|earlier| earlier.is_before(one))
        };
        let at = (0..self.waiting.len()).find(may_go)?;
        let Waiting { job, scene, ready, .. } = self.waiting.remove(at);
        ready.map(|ready| Turn { job, scene, ready })
    }

    /// Returns the requests of this client that wait for nothing but their turn.
    pub fn held(&self, client: SessionId) -> impl Iterator<Item = ClientRequest> {
        let ready = self.waiting.iter().filter(|one| one.ready.is_some()).map(|one| one.job);
        ready.filter(move |job| job.client == client)
    }

    /// Forgets what a client waits for that is gone.
    pub fn forget(&mut self, client: SessionId) {
        self.waiting.retain(|one| one.job.client != client);
    }
}

impl<T> Waiting<T> {
    /// Returns whether this one, which came earlier, must go before a later one.
    fn is_before(&self, later: &Self) -> bool {
        self.job.client == later.job.client && !self.targets.is_disjoint(&later.targets)
    }
}

#[cfg(test)]
mod tests {
    use polyptych_protocol::ids::RequestId;
    use polyptych_scene::{NewNode, NodeId};

    use super::*;

    const ANN: SessionId = SessionId(1);
    const BOB: SessionId = SessionId(2);
    const SCENE: Revision = Revision(7);

    fn job(client: SessionId, id: u64) -> ClientRequest {
        ClientRequest { client, id: RequestId(id) }
    }

    /// A transaction that makes a node and shows another one, if given.
    fn showing(node: Option<u64>) -> Transaction {
        let mut transaction = Transaction::default();
        transaction.create(NewNode::default());
        if let Some(node) = node {
            transaction.set_visible(NodeId(node), true);
        }
        transaction
    }

    /// The numbers of the requests whose turn has come.
    fn popped(queue: &mut TransactionQueue<&'static str>, client: SessionId) -> Vec<u64> {
        std::iter::from_fn(|| queue.pop(client).map(|turn| turn.job.id.0)).collect()
    }

    #[test]
    fn what_changes_the_same_goes_in_its_clients_order() {
        let mut queue = TransactionQueue::new();
        let [first, second, third] =
            [1, 2, 3].map(|id| queue.add_reading(job(ANN, id), SCENE, &showing(Some(4))));
        let other = queue.add_reading(job(BOB, 1), SCENE, &showing(Some(4)));
        let apart = queue.add_reading(job(ANN, 4), SCENE, &showing(None));
        queue.set_ready(apart, "read");
        assert_eq!(popped(&mut queue, ANN), [4], "it only makes something");
        queue.set_ready(third, "read");
        queue.set_ready(other, "read");
        assert_eq!((popped(&mut queue, ANN), popped(&mut queue, BOB)), (vec![], vec![1]));
        assert_eq!(queue.held(ANN).collect::<Vec<_>>(), [job(ANN, 3)]);
        // One that cannot be holds no other up.
        queue.set_ready(first, "refused");
        let turn = queue.pop(ANN).expect("its turn");
        assert_eq!(turn, Turn { job: job(ANN, 1), scene: SCENE, ready: "refused" });
        assert_eq!(popped(&mut queue, ANN), [0; 0]);
        queue.set_ready(second, "read");
        assert_eq!(popped(&mut queue, ANN), [2, 3]);
        assert!(queue.waiting.is_empty());
    }

    #[test]
    fn one_without_files_waits_for_those_only_that_change_the_same() {
        let mut queue = TransactionQueue::new();
        assert!(!queue.holds(ANN, &showing(Some(4))), "nothing waits");
        let first = queue.add_reading(job(ANN, 1), SCENE, &showing(Some(4)));
        let second = queue.add_reading(job(ANN, 2), SCENE, &showing(Some(5)));
        assert!(!queue.holds(ANN, &showing(Some(6))), "another node");
        assert!(!queue.holds(ANN, &showing(None)), "what both make has no number yet");
        assert!(!queue.holds(BOB, &showing(Some(4))), "another client");
        let mut paint = Transaction::default();
        paint.set_material(4, polyptych_scene::Material::default());
        assert!(!queue.holds(ANN, &paint), "a material with the number of a node");
        assert!(queue.holds(ANN, &showing(Some(4))));
        queue.add_held(job(ANN, 3), SCENE, &showing(Some(4)), "later");
        // A transaction that waits is itself waited for.
        let mut both = showing(Some(4));
        both.set_name(NodeId(6), "quay");
        assert!(queue.holds(ANN, &both));
        queue.add_held(job(ANN, 4), SCENE, &both, "later");
        let mut name = Transaction::default();
        name.set_name(NodeId(6), "mole");
        assert!(queue.holds(ANN, &name));
        queue.add_held(job(ANN, 5), SCENE, &name, "later");
        queue.set_ready(second, "read");
        assert_eq!(popped(&mut queue, ANN), [2]);
        queue.set_ready(first, "read");
        assert_eq!(popped(&mut queue, ANN), [1, 3, 4, 5]);
    }

    #[test]
    fn one_without_files_goes_with_that_for_which_it_waits() {
        let mut queue = TransactionQueue::new();
        let first = queue.add_reading(job(ANN, 1), SCENE, &showing(Some(4)));
        queue.add_reading(job(ANN, 2), SCENE, &showing(Some(5)));
        queue.add_held(job(ANN, 3), SCENE, &showing(Some(4)), "later");
        queue.set_ready(first, "read");
        assert_eq!(popped(&mut queue, ANN), [1, 3], "the second is still being read");
    }

    #[test]
    fn what_a_client_waits_for_that_is_gone_is_forgotten() {
        let mut queue = TransactionQueue::new();
        let first = queue.add_reading(job(ANN, 1), SCENE, &showing(Some(4)));
        queue.add_held(job(ANN, 2), SCENE, &showing(Some(4)), "later");
        let other = queue.add_reading(job(BOB, 1), SCENE, &showing(None));
        queue.forget(ANN);
        queue.set_ready(first, "read");
        queue.set_ready(other, "read");
        assert_eq!((popped(&mut queue, ANN), popped(&mut queue, BOB)), (vec![], vec![1]));
    }
}
