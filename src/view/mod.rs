//! What screens show of a vehicle under way beside the snapshot: the link, the recording, who flies, the last minutes. No sockets and no clock: the
//! program's own screens (`sinks`) and the page in the browser are filled from the same values.

pub mod history;
pub mod link_meter;
pub mod listener;
pub mod mission_watch;
pub mod received;
pub mod status;
