//! What a user may get wrong: one clear sentence on stderr, exit status 1 or 2, and never a panic.

#![allow(clippy::unwrap_used, clippy::panic, reason = "helpers of tests may panic, as tests do")]

use crate::support;
use std::fs;
use std::io::Write;
use std::net::{TcpListener, UdpSocket};
use support::{Ended, Folder, fixture, gaware};

/// Runs it, and checks the manners that every failure has to have.
fn fails(code: i32, said: &str, args: &[&str]) -> Ended {
    let ended = gaware(args);
    assert_eq!(ended.code(), Some(code), "{args:?}: {}", ended.stderr);
    assert!(ended.stderr.contains(said), "{args:?}: {}", ended.stderr);
    assert!(!ended.stderr.contains("panicked"), "{args:?}: {}", ended.stderr);
    let sentences = ended.stderr.lines().filter(|l| l.starts_with("gaware: ") || l.starts_with("error: "));
    assert_eq!(sentences.count(), 1, "{args:?}: {}", ended.stderr);
    ended
}

/// Bytes that look like nothing, the same every time.
fn noise(n: usize) -> Vec<u8> {
    let mut state = 0x2545_f491_u32;
    let mut next = || {
        state ^= state << 13;
        state ^= state >> 17;
        state ^= state << 5;
        (state >> 24) as u8
    };
    std::iter::repeat_with(&mut next).take(n).collect()
}

#[test]
fn logs_in_which_nothing_can_be_read_are_refused_in_one_sentence() {
    let folder = Folder::new("rubbish");
    let none = "unsupported format; gaware reads";
    let nothing = "entry could be read";
    let cases: [(&str, &[u8], &str); 9] = [
        ("noise.bin", b"", none),
        ("noise.mcap", b"", none),
        ("noise.ulg", b"", none),
        ("noise.txt", b"", none),
        ("noise", b"", none),
        ("noise.tlog", b"", nothing),
        ("headed.mcap", b"\x89MCAP0\r\n", nothing),
        ("headed.bin", b"\xa3\x95", nothing),
        ("headed.ulg", b"ULog\x01\x12\x35", nothing),
    ];
    for (name, head, said) in cases {
        let file = folder.file(name);
        fs::write(&file, [head, &noise(5000)].concat()).unwrap();
        let ended = fails(1, said, &["replay", &file, "--json"]);
        assert_eq!(ended.stdout, "", "{name}");
    }
    let empty = folder.file("empty.tlog");
    fs::write(&empty, b"").unwrap();
    fails(1, "is empty", &["replay", &empty]);
    let lone = folder.file("fixes.csv");
    fs::write(&lone, "t_s,lat_deg\n").unwrap();
    fails(1, "no imu.csv beside", &["replay", &lone]);
    fails(1, "No such file", &["replay", &folder.file("missing.tlog")]);
    fails(1, "directory", &["replay", &folder.file("")]);
}

#[test]
fn what_is_left_of_a_cut_or_misnamed_log_is_used_and_the_rest_counted() {
    let folder = Folder::new("cut");
    let whole = fs::read(fixture("small_clean_dither.tlog")).unwrap();
    let cut = folder.file("cut.tlog");
    fs::write(&cut, &whole[..300_001]).unwrap();
    let misnamed = folder.file("really_a_tlog.mcap");
    fs::write(&misnamed, &whole[..300_001]).unwrap();
    let mut hit = whole[..300_001].to_vec();
    hit[100_000..102_000].copy_from_slice(&noise(2000));
    let damaged = folder.file("damaged.tlog");
    fs::write(&damaged, hit).unwrap();
    let documents = [&cut, &misnamed, &damaged].map(|file| {
        let ended = gaware(&["replay", file, "--json"]);
        assert_eq!(ended.code(), Some(0), "{}", ended.stderr);
        let document = ended.json();
        support::assert_finite(&document, file);
        assert_eq!(document["log_damage"]["truncated"], true);
        assert!(document["warnings"].to_string().contains("the log is damaged"), "{document:#}");
        document
    });
    assert_eq!(documents[0], documents[1], "the name does not matter");
    assert!(documents[2]["log_damage"]["skipped_bytes"].as_u64().unwrap() >= 2000);
    let samples = |k: usize| documents[k]["imu"]["samples"].as_u64().unwrap();
    assert!(samples(2) > samples(0) - 60 && samples(2) < samples(0), "{} of {}", samples(2), samples(0));
}

/// Pipes without a writer hung, and devices never ended.
#[cfg(unix)]
#[test]
fn pipes_and_devices_are_no_files() {
    let folder = Folder::new("pipes");
    let pipe = folder.file("pipe.tlog");
    assert!(std::process::Command::new("mkfifo").arg(&pipe).status().unwrap().success());
    let log = fixture("small_clean_dither.tlog");
    let log = log.to_str().unwrap();
    for path in [pipe.as_str(), "/dev/zero"] {
        fails(1, "no regular file", &["replay", path]);
        fails(1, "no regular file", &["replay", log, "--model", path]);
        fails(1, "no regular file", &["explain", log, "--parameters", path, "--out", &folder.file("out")]);
        fails(
            1,
            "no regular file",
            &["plan", "--airframe", path, "--home", "47.4,8.5,400", "--out", &folder.file("p.plan")],
        );
        fails(1, "no regular file", &["mission", "upload", path, "--connect", "udpin:127.0.0.1:0"]);
        fails(1, "no regular file", &["params", "apply", path, "--yes", "--connect", "udpin:127.0.0.1:0"]);
        fails(1, "no regular file", &["run", "--connect", "udpin:127.0.0.1:0", "--signing-key", path]);
    }
}

#[test]
fn models_and_baselines_with_mistakes_are_refused_with_their_place() {
    let folder = Folder::new("model");
    let log = fixture("small_clean_dither.tlog");
    let log = log.to_str().unwrap();
    let model = folder.file("typo.toml");
    fs::write(&model, "schema = \"gaware.model/1\"\n[imu]\ngyro_noize = 1.0\n").unwrap();
    fails(1, "line 3: unknown field `gyro_noize`", &["replay", log, "--model", &model]);
    fails(1, "No such file", &["replay", log, "--model", &folder.file("none.toml")]);
    fails(1, "is no baseline", &["replay", log, "--json", "--baseline", &model]);
}

#[test]
fn addresses_that_are_none_are_wrong_usage() {
    for (address, said) in [
        ("nowhere", "is not a valid address; write"),
        ("udpin:host:14550", "udpin waits on a local IP address"),
        ("serial:/dev/ttyAMA0:fast", "is no baud rate"),
        ("tcpout:127.0.0.1:99999", "a port from 1 to 65535"),
    ] {
        fails(2, said, &["run", "--connect", address, "--no-record"]);
    }
    for duration in ["nan", "1e30", "inf", "soon"] {
        fails(2, "a number of seconds", &["run", "--connect", "udpin:127.0.0.1:0", "--duration", duration]);
    }
    fails(2, "--connect", &["run"]);
}

#[test]
fn a_run_whose_links_never_open_fails_and_says_why() {
    let taken = UdpSocket::bind("127.0.0.1:0").unwrap();
    let taken = format!("udpin:{}", taken.local_addr().unwrap());
    for (address, said) in [
        (taken.as_str(), "in use"),
        ("tcpout:127.0.0.1:1", "refused"),
        ("serial:/dev/gaware-no-such-port", "No such file"),
        ("udpout:no-such-host.invalid:14550", "cannot resolve"),
    ] {
        let args = ["run", "--connect", address, "--no-record", "--headless", "--json", "--duration", "0.3"];
        let ended = fails(1, "no link could be opened", &args);
        assert!(ended.stderr.contains(said), "{}", ended.stderr);
        assert_eq!(ended.json()["imu"]["samples"], 0, "the result is printed nevertheless");
    }
}

/// A vehicle that is switched on later: one line while there is none, one when bytes come, whosesoever.
#[test]
fn a_link_that_is_down_is_told_once_and_again_when_it_is_back() {
    let address = TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap();
    let link = format!("tcpout:{address}");
    let nowhere = ["mission", "download", "never-written.plan", "--connect", &link, "--patience"];
    let ended = fails(1, "no heartbeat", &[&nowhere[..], &["2"]].concat());
    assert_eq!(ended.stderr.matches("link is down").count(), 1, "{}", ended.stderr);
    let companion = support::Gaware::start(&[&nowhere[..], &["100"]].concat());
    let first = companion.line();
    assert!(first.contains("link is down"), "{first}");
    let (mut vehicle, _) = TcpListener::bind(address).unwrap().accept().unwrap();
    vehicle.write_all(&[0; 20]).unwrap();
    let second = companion.line();
    assert!(second.contains("link is up again"), "{second}");
}

#[test]
fn a_recording_never_overwrites_an_earlier_one() {
    let folder = Folder::new("overwrite");
    let file = folder.file("flight.mcap");
    fs::write(&file, b"precious").unwrap();
    let args =
        ["run", "--connect", "udpin:127.0.0.1:0", "--headless", "--duration", "0.3", "--record", &file];
    fails(1, "exists already", &args);
    assert_eq!(fs::read(&file).unwrap(), b"precious");
    fails(1, "cannot record to", &[&args[..7], &["/dev/null/flight.mcap"]].concat());
}

#[test]
fn wrong_arguments_of_sim_are_explained() {
    let taken = UdpSocket::bind("127.0.0.1:0").unwrap();
    let taken = format!("udpin:{}", taken.local_addr().unwrap());
    fails(2, "known are paper, ", &["sim", "--scenario", "moon"]);
    fails(2, "is an invalid address; write", &["sim", "--listen", "nowhere"]);
    fails(2, "is no speed", &["sim", "--speed", "0"]);
    fails(2, "UDP loses frames", &["sim", "--speed", "max"]);
    fails(2, "there is no effect", &["sim", "--hide", "gremlins=1"]);
    fails(2, "is no fault; known are", &["sim", "--fault", "gremlins"]);
    fails(2, "out of range", &["sim", "--until", "nan"]);
    fails(1, "in use", &["sim", "--listen", &taken]);
    let args = ["sim", "--listen", "tcpin:127.0.0.1:0", "--record", "/dev/null/flight.tlog"];
    fails(1, "cannot write the recording", &args);
}

/// Runs it with its stdout led elsewhere by a shell.
fn led(to: &str, args: &[&str]) -> Ended {
    support::Gaware::start_with_stdout(to, args).ended()
}

#[test]
fn a_result_is_told_though_its_page_cannot_be_written_and_no_folder_is_left_behind() {
    let folder = Folder::new("page");
    let page = folder.file("no/such/folder.html");
    let demo = ["demo", "--speed", "max", "--budget", "200", "--report", &page];
    let ended = fails(1, "cannot write", &demo);
    assert!(ended.stdout.contains("the mission was flown"), "{}", ended.stdout);
    let (log, out) = (folder.file("noise.tlog"), folder.file("out"));
    fs::write(&log, noise(5000)).unwrap();
    fails(1, "entry could be read", &["explain", &log, "--out", &out]);
    assert!(!fs::exists(&out).unwrap());
    let taken = fixture("small_clean_dither.tlog").to_str().unwrap().to_owned();
    fails(1, "cannot write", &["explain", &taken, "--out", &log]);
}

#[test]
fn bands_of_heights_that_cannot_be_are_wrong_usage() {
    let run = ["run", "--connect", "udpin:127.0.0.1:0", "--no-record", "--headless"];
    let guided = [&run[..], &["--airframe", "quadrotor"]].concat();
    fails(
        2,
        "--floor 90 is not below --ceiling 70",
        &[&guided[..], &["--floor", "90", "--ceiling", "70"]].concat(),
    );
    fails(2, "--floor -5 is below the ground", &[&guided[..], &["--floor", "-5"]].concat());
    fails(2, "say with --airframe what flies", &[&run[..], &["--ceiling", "70"]].concat());
    fails(2, "--ceiling NaN is no number", &["demo", "--speed", "max", "--ceiling", "NaN"]);
    fails(
        2,
        "--floor 50 is not below --ceiling 40",
        &["plan", "--home", "47,8,500", "--floor", "50", "--ceiling", "40"],
    );
}

#[test]
fn a_reader_who_has_seen_enough_is_no_failure_and_a_full_disk_is_one() {
    let folder = Folder::new("stdout");
    let log = fixture("small_clean_dither.tlog").to_str().unwrap().to_owned();
    let page = folder.file("page.html");
    let plan = ["plan", "--home", "47,8,500", "--budget", "120"];
    let commands: [&[&str]; 6] = [
        &["completions", "zsh"],
        &["replay", &log],
        &["replay", &log, "--json"],
        &["report", &log, "--out", &page],
        &plan,
        &[&plan[..], &["--json"]].concat(),
    ];
    for args in commands {
        let gone = led("| true", args);
        assert_eq!(gone.code(), Some(0), "{args:?}: {}", gone.stderr);
        assert_eq!(gone.stderr, "", "{args:?}");
        let full = led("> /dev/full", args);
        assert_eq!(full.code(), Some(1), "{args:?}: {}", full.stderr);
        assert!(full.stderr.contains("gaware: cannot write the result: No space left"), "{}", full.stderr);
    }
}

#[test]
fn numbers_that_are_none_name_the_option_the_value_and_the_remedy() {
    for (said, args) in [
        ("--rate", &["run", "--connect", "udpin:127.0.0.1:0", "--rate", "abc"][..]),
        ("--seed", &["sim", "--seed", "abc"]),
        ("--radius", &["plan", "--home", "47,8,500", "--radius", "wide"]),
    ] {
        let ended = fails(2, said, args);
        let value = args.last().unwrap();
        assert!(ended.stderr.contains(value) && ended.stderr.contains("write a"), "{}", ended.stderr);
    }
}

#[test]
fn a_run_that_hears_nothing_says_so_and_has_failed() {
    let ended = fails(
        1,
        "nothing was received",
        &["run", "--connect", "udpin:127.0.0.1:0", "--no-record", "--headless", "--duration", "0.5"],
    );
    assert_eq!(ended.stdout, "", "no table of zeros");
}

#[test]
fn a_stderr_that_is_closed_or_that_nobody_reads_holds_nothing_up() {
    let run = ["run", "--connect", "udpin:127.0.0.1:0", "--no-record", "--headless", "--duration", "1"];
    for closed in [true, false] {
        let (reader, mut writer) = std::io::pipe().unwrap();
        // As much as a pipe holds: whoever writes more waits for a reader.
        writer.write_all(&[b'.'; 65_536]).unwrap();
        let reader = (!closed).then_some(reader);
        let mut child = std::process::Command::new(env!("CARGO_BIN_EXE_gaware"))
            .args(run)
            .stdout(std::process::Stdio::null())
            .stderr(writer)
            .spawn()
            .unwrap();
        let (ended, wait) = std::sync::mpsc::channel();
        let id = child.id();
        std::thread::spawn(move || ended.send(child.wait().unwrap()));
        let Ok(status) = wait.recv_timeout(support::PATIENCE) else { panic!("process {id} does not end") };
        assert_eq!(status.code(), Some(1), "as with a reader: nothing was received (closed: {closed})");
        drop(reader);
    }
}

#[test]
fn names_of_files_models_and_airframes_give_the_terminal_no_orders() {
    let folder = Folder::new("orders");
    let order = "\u{1b}]0;owned\u{7}\u{1b}[2J";
    let model = folder.file("model.toml");
    fs::write(&model, format!("schema = \"{}\"\n", "\\u001b[2Jother/9")).unwrap();
    let airframe = folder.file("airframe.toml");
    let own = fs::read_to_string(format!("{}/mission/airframes/quadrotor.toml", env!("CARGO_MANIFEST_DIR")))
        .unwrap();
    fs::write(&airframe, own.replace("name = \"quadrotor\"", "name = \"quad\\u001b[2J\"")).unwrap();
    let log = fixture("small_clean_dither.tlog");
    let log = log.to_str().unwrap();
    let missing = folder.file(&format!("{order}.tlog"));
    let named = folder.file(&format!("{order}.html"));
    let lines: [&[&str]; 6] = [
        &["replay", &missing],
        &["replay", log, "--model", &model],
        &["plan", "--airframe", &airframe, "--home", "47.397,8.545,441", "--budget", "60"],
        &["report", log, "--out", &named],
        &["mission", "upload", &missing, "--connect", order],
        &["sim", "--scenario", order],
    ];
    for line in lines {
        let ended = gaware(line);
        for text in [&ended.stdout, &ended.stderr] {
            assert!(!text.contains(['\u{1b}', '\u{7}']), "{line:?}: {text:?}");
        }
        assert!(!(ended.stdout + &ended.stderr).is_empty(), "{line:?}");
    }
}
