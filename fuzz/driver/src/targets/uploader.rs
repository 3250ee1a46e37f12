//! The uploader of a run against arbitrary frames, in virtual time: every request is answered, and the task ends when it is to.

use super::transfer::mission;
use crate::script::{self, Kind, Step};
use crate::vehicle::{self, HonestVehicle};
use gaware::link::endpoint::Received;
use gaware::link::frame::{Frame, Sender};
use gaware::mission_link::codec;
use gaware::mission_link::uploader::{Offer, Planned, RawMessage, Uploader};
use gaware::sinks::live::Live;
use gaware::sinks::status::SinkStatus;
use gaware::sinks::{Change, Request};
use gaware_mission::fence::Fence;
use gaware_mission::files::plan::{self, PlanFile};
use gaware_mission::item::Autopilot;
use std::path::PathBuf;
use std::sync::{Arc, LazyLock};
use std::time::Duration;
use std::{env, fs, io, panic};
use tokio::sync::{broadcast, mpsc, oneshot, watch};
use tokio::time::{Instant, sleep_until, timeout, timeout_at};
use tokio_util::sync::CancellationToken;

/// The answer to a request comes within this time once the vehicle answers every message.
const PATIENCE: Duration = Duration::from_secs(3600);
/// Between two heartbeats.
const HEARTBEAT: Duration = Duration::from_secs(1);
/// Longest time between two steps: more than any timer of a transfer but that of a link that is gone.
const LONGEST_WAIT: Duration = Duration::from_secs(10);

/// A folder of this process with the plan, in memory where the system has such a place.
static FOLDER: LazyLock<io::Result<(PathBuf, Planned)>> = LazyLock::new(|| {
    let base = PathBuf::from("/dev/shm");
    let base = if base.is_dir() { base } else { env::temp_dir() };
    let folder = base.join(format!("gaware-fuzz-uploader-{}", std::process::id()));
    fs::create_dir_all(&folder)?;
    let file = folder.join("planned.plan");
    let contents = PlanFile::new(mission(9, 0.0), Fence::default(), Autopilot::Px4, 1);
    fs::write(&file, plan::write(&contents))?;
    let planned = Planned::load(&file).map_err(io::Error::other)?;
    Ok((folder, planned))
});

/// The other side of the uploader's channels.
struct Link {
    frames: broadcast::Sender<Received>,
    outbox: mpsc::Receiver<RawMessage>,
    vehicle: HonestVehicle,
    heartbeat_due: Instant,
    began: Instant,
}

impl Link {
    fn send(&self, frame: Frame) {
        // Where the task has ended no one receives.
        let _ = self.frames.send(Received { link: 0, peer: None, t_us: 0, frame });
    }

    /// The vehicle takes what was sent to it.
    fn take(&mut self, RawMessage { id, payload, .. }: RawMessage) {
        let from = Sender { system_id: 1, component_id: 191 };
        let frame = Frame::of_payload(from, 0, id, &payload);
        if let Some(envelope) = frame.ok().as_ref().and_then(codec::decode) {
            self.vehicle.receive(self.began.elapsed().as_secs_f64(), &envelope.message);
        }
    }

    fn deliver(&mut self) {
        let message = self.vehicle.next_message(self.began.elapsed().as_secs_f64());
        if let Some(frame) = message.as_ref().and_then(vehicle::frame) {
            self.send(frame);
        }
    }

    /// Lets time pass, with a heartbeat each second.
    async fn wait(&mut self, time: Duration) {
        let until = Instant::now() + time;
        while self.wait_for_message(until).await {}
    }

    /// Until the program has sent something, true, or at the longest until a time.
    async fn wait_for_message(&mut self, until: Instant) -> bool {
        loop {
            let next = until.min(self.heartbeat_due);
            match timeout_at(next, self.outbox.recv()).await {
                Ok(Some(message)) => {
                    self.take(message);
                    return true;
                }
                // Nothing is sent any more once the task has ended.
                Ok(None) => sleep_until(next).await,
                Err(_) => {}
            }
            if Instant::now() >= self.heartbeat_due {
                vehicle::heartbeat_frame().into_iter().for_each(|f| self.send(f));
                self.heartbeat_due = Instant::now() + HEARTBEAT;
            }
            if Instant::now() >= until {
                return false;
            }
        }
    }
}

/// The first two bytes are not used, the rest is a script.
pub fn uploader(data: &[u8]) -> bool {
    let Ok((folder, planned)) = &*FOLDER else { return false };
    let runtime = tokio::runtime::Builder::new_current_thread().enable_time().start_paused(true).build();
    let Ok(runtime) = runtime else { return false };
    let steps = script::read(data.get(2..).unwrap_or_default());
    let uploaded = runtime.block_on(run(planned.clone(), &steps));
    for entry in fs::read_dir(folder).into_iter().flatten().flatten() {
        if entry.file_name() != "planned.plan" {
            let _ = fs::remove_file(entry.path());
        }
    }
    uploaded
}

/// True where an upload came to its end.
async fn run(planned: Planned, steps: &[Step]) -> bool {
    let (frames, received) = broadcast::channel(256);
    let (outbox_in, outbox) = mpsc::channel(64);
    let (_live, live) = watch::channel(Arc::new(Live { vehicle: Some(1), ..Live::default() }));
    let (requests, requested) = mpsc::channel(4);
    let stop = CancellationToken::new();
    let status = SinkStatus::new();
    let uploader = Uploader::new(
        Offer { mission: Some(planned), ..Offer::default() },
        None,
        received,
        outbox_in,
        live,
        status,
    );
    let task = tokio::spawn(uploader.run(requested, stop.clone()));
    let vehicle = HonestVehicle::new(mission(5, 20.0).wire_items(Autopilot::Px4));
    let mut link = Link { frames, outbox, vehicle, heartbeat_due: Instant::now(), began: Instant::now() };
    link.wait(HEARTBEAT).await;
    let mut answers = vec![ask(&requests)];
    for (number, step) in steps.iter().enumerate() {
        link.wait(LONGEST_WAIT.min(Duration::from_millis(u64::from(step.wait_ms)))).await;
        match step.kind() {
            Kind::Frame => step.frame(number as u8).into_iter().for_each(|f| link.send(f)),
            Kind::Deliver => link.deliver(),
            Kind::Lose => _ = link.vehicle.next_message(link.began.elapsed().as_secs_f64()),
            Kind::Repeat => link.vehicle.delay(true),
            Kind::Delay => link.vehicle.delay(false),
            Kind::Cancel => stop.cancel(),
            Kind::Again => answers.push(ask(&requests)),
        }
        if stop.is_cancelled() {
            break;
        }
    }
    // From now on every message is answered.
    let until = Instant::now() + PATIENCE;
    let mut uploaded = false;
    loop {
        answers.retain_mut(|answer| match answer.as_mut().map(oneshot::Receiver::try_recv) {
            Some(Ok(result)) => {
                uploaded |= result.is_ok();
                false
            }
            Some(Err(oneshot::error::TryRecvError::Empty)) => true,
            _ => false,
        });
        if answers.is_empty() {
            break;
        }
        assert!(Instant::now() < until, "a request is not answered");
        link.wait_for_message(Instant::now() + HEARTBEAT).await;
        while !link.vehicle.is_silent() {
            link.deliver();
        }
    }
    stop.cancel();
    match timeout(PATIENCE, task).await {
        Ok(Ok(())) => {}
        Ok(Err(error)) => match error.try_into_panic() {
            Ok(message) => panic::resume_unwind(message),
            Err(error) => panic!("{error}"),
        },
        Err(_) => panic!("the task does not end"),
    }
    uploaded
}

/// Asks for an upload; nothing where the queue is full.
fn ask(requests: &mpsc::Sender<Request>) -> Option<oneshot::Receiver<Result<String, String>>> {
    let (reply, answer) = oneshot::channel();
    requests.try_send(Request { change: Change::Mission, reply }).ok().map(|()| answer)
}
