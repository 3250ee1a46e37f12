//! What the service manager of the system sees of a run.

#![cfg(unix)]
#![allow(clippy::unwrap_used, clippy::panic, reason = "helpers of tests may panic, as tests do")]

use crate::support;
use std::os::unix::net::UnixDatagram;
use std::process::{Child, Command, Stdio};
use support::{Folder, PATIENCE};

/// A run that does not outlive the test.
struct Run(Child);

impl Drop for Run {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

fn next(socket: &UnixDatagram) -> String {
    let mut buffer = [0; 256];
    let n = socket.recv(&mut buffer).unwrap();
    String::from_utf8_lossy(buffer.get(..n).unwrap_or_default()).into_owned()
}

#[test]
fn a_run_reports_that_it_is_ready_that_it_is_alive_and_that_it_ends() {
    let folder = Folder::new("service");
    let path = folder.file("notify");
    let socket = UnixDatagram::bind(&path).unwrap();
    socket.set_read_timeout(Some(PATIENCE)).unwrap();
    let child = Command::new(env!("CARGO_BIN_EXE_gaware"))
        .args(["run", "--connect", "udpin:127.0.0.1:0", "--headless", "--no-record"])
        .env("NOTIFY_SOCKET", &path)
        .env("WATCHDOG_USEC", "1000000")
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    let mut run = Run(child);
    assert_eq!(next(&socket), "READY=1");
    assert_eq!([next(&socket), next(&socket)], ["WATCHDOG=1", "WATCHDOG=1"]);
    assert!(Command::new("kill").args(["-TERM", &run.0.id().to_string()]).status().unwrap().success());
    let last = std::iter::repeat_with(|| next(&socket)).find(|m| m != "WATCHDOG=1").unwrap();
    assert_eq!(last, "STOPPING=1");
    run.0.wait().unwrap();
}
