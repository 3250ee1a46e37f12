//! `gaware serve --web`: the page that analyses logs in the browser, from a companion board or a lab server.

use super::foxglove::listen_address;
use super::{CommandError, signals, start};
use crate::sinks::log;
use crate::sinks::web::{analysis, door};
use std::net::SocketAddr;
use std::path::{Path, PathBuf};
use tokio_util::sync::CancellationToken;

/// Name of the page's file.
const PAGE: &str = "gaware.html";

/// Arguments of `serve`.
#[derive(Debug, Clone, clap::Args)]
pub struct ServeArgs {
    /// The page that analyses logs in the browser. Logs stay there: nothing is sent to this machine.
    #[arg(long, required = true)]
    pub web: bool,
    /// Address and port, or a port of this machine alone.
    #[arg(long, value_name = "ADDR", default_value = "127.0.0.1:8090", value_parser = listen_address)]
    pub listen: SocketAddr,
    /// The page's file (default: gaware.html beside the program, in ../share/gaware or ../web), which web/build makes.
    #[arg(long, value_name = "FILE")]
    pub page: Option<PathBuf>,
}

/// Serves until a signal.
///
/// # Errors
/// There is no page, or the address is taken.
pub fn run(args: &ServeArgs) -> Result<(), CommandError> {
    let path = match &args.page {
        Some(path) => path.clone(),
        None => beside_program().ok_or_else(|| {
            let reason =
                "it is not beside the program: build it with web/build, or name its file with --page";
            let source = std::io::Error::new(std::io::ErrorKind::NotFound, reason);
            CommandError::Read { path: PAGE.into(), source }
        })?,
    };
    let page = crate::inputs::bytes(&path).map_err(|source| CommandError::Read { path, source })?;
    start::runtime()?.block_on(async {
        let address = args.listen;
        let stop = CancellationToken::new();
        signals::cancel_on_signal(&stop);
        let failed = |reason: String| CommandError::Web { address, reason };
        let listener = door::bind(address).map_err(|e| failed(e.to_string()))?;
        let bound = listener.local_addr().map_err(|e| failed(e.to_string()))?;
        log::line(&format!("web page: http://{}/", start::address_to_open(bound)));
        analysis::serve(listener, page, stop).await.map_err(|e| failed(e.to_string()))
    })
}

/// The page of this installation.
fn beside_program() -> Option<PathBuf> {
    let program = std::env::current_exe().ok()?;
    let folder = program.parent()?;
    ["", "../share/gaware", "../web"]
        .map(Path::new)
        .iter()
        .map(|p| folder.join(p).join(PAGE))
        .find(|p| p.is_file())
}
