//! The order of a device's packets, and their sender.

use std::net::SocketAddr;

use crate::Micros;

/// Time by which a time tag may lie before the last one and still be late instead of the first of
/// a clock that was set: 10 s, in units of 2⁻³² s.
const LATE_MAX: u64 = 10 << 32;

/// The reason to ignore a packet.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub(crate) enum OrderFault {
    /// The packet was overtaken by a later one.
    #[error("a packet that came after one with a later time tag is ignored")]
    Overtaken,
    /// The packet comes from another sender than those before.
    #[error("packets of {0} are ignored while those of {1} come; end one of both senders")]
    OtherSender(SocketAddr, SocketAddr),
}

/// The last accepted packet of a device.
#[derive(Clone, Debug)]
pub(crate) struct PacketOrder {
    silence_max: Micros,
    last: Option<LastPacket>,
}

#[derive(Clone, Copy, Debug)]
struct LastPacket {
    at: Micros,
    from: SocketAddr,
    time_tag: Option<u64>,
}

impl PacketOrder {
    /// Creates an order that accepts another sender after a silence of `silence_max`.
    pub fn new(silence_max: Micros) -> Self {
        Self { silence_max, last: None }
    }

    /// Records a packet.
    ///
    /// # Errors
    /// The reason to ignore the packet.
    pub fn accept(
        &mut self,
        now: Micros,
        from: SocketAddr,
        time_tag: Option<u64>,
    ) -> Result<(), OrderFault> {
        let silence_max = self.silence_max;
        let last = self.last.filter(|last| now.saturating_sub(last.at) < silence_max);
        if let Some(last) = last.filter(|last| last.from != from) {
            return Err(OrderFault::OtherSender(from, last.from));
        }
        let newest = last.and_then(|last| last.time_tag);
        if let (Some(tag), Some(newest)) = (time_tag, newest)
            && tag < newest
            && newest - tag < LATE_MAX
        {
            return Err(OrderFault::Overtaken);
        }
        self.last = Some(LastPacket { at: now, from, time_tag: time_tag.or(newest) });
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn overtaken_packets_and_second_senders_are_ignored_until_the_first_is_silent() {
        let [one, two] = [1, 2].map(|port| SocketAddr::from(([127, 0, 0, 1], port)));
        let mut order = PacketOrder::new(500_000);
        let second = 1 << 32;
        assert_eq!(order.accept(0, one, Some(100 * second)), Ok(()));
        assert_eq!(order.accept(1, one, Some(100 * second - 1)), Err(OrderFault::Overtaken));
        assert_eq!(order.accept(2, one, Some(100 * second)), Ok(()), "bundles share a tag");
        assert_eq!(order.accept(3, one, None), Ok(()), "one without a tag came in its turn");
        assert_eq!(order.accept(4, one, Some(99 * second)), Err(OrderFault::Overtaken));
        assert_eq!(order.accept(5, two, None), Err(OrderFault::OtherSender(two, one)));
        assert_eq!(order.accept(6, one, Some(5 * second)), Ok(()), "its clock was set");
        assert_eq!(order.accept(500_005, two, None), Err(OrderFault::OtherSender(two, one)));
        assert_eq!(order.accept(500_006, two, None), Ok(()), "the first one is silent");
    }
}
