use super::*;
use crate::engine::situation::{Control, Situation, SituationKind};
use crate::engine::snapshot::{Condition, Direction, Phase, StateStatus, Status};
use crate::sinks::events::{Severity, Topic};
use crate::sinks::status::{
    LinkState, LinkView, MissionState, MissionView, ParametersView, RecorderState, RecorderView, StatusView,
};
use ratatui::backend::TestBackend;
use ratatui::style::Color;
use std::collections::VecDeque;

fn situation(kind: SituationKind, headline: &str, text: &str, detail: &str) -> Situation {
    let control = if kind == SituationKind::Maneuver { Control::Pilot } else { Control::Autopilot };
    Situation {
        kind,
        level: kind.level(),
        control,
        mode: "FBWA".into(),
        headline: headline.into(),
        text: text.into(),
        detail: detail.into(),
    }
}

fn flying() -> Snapshot {
    let mut s = Snapshot { phase: Phase::Running, elapsed_s: 3723.4, sequence: 7, ..Snapshot::default() };
    s.autopilot = "ardupilot".into();
    s.imu.message = "RAW_IMU".into();
    (s.imu.rate_hz, s.imu.dropped) = (99.6, 12);
    (s.gnss.rate_hz, s.gnss.used, s.gnss.rejected) = (5.0, 323, 2);
    s.consistency.nis_mean_per_dof = 1.08;
    let met = Condition { met: true, progress: 1.0, missing: String::new() };
    let part = |progress, missing: &str| Condition { met: false, progress, missing: missing.into() };
    s.observability.conditions.a = met;
    s.observability.conditions.b = part(0.62, "specific force y does not change yet: sideslip");
    s.observability.conditions.c = part(0.999, "a third independent change");
    let g = &mut s.estimate.g_sensitivity_deg_per_h_per_g;
    for r in 0..3 {
        for c in 0..3 {
            let sigma = [29.1, 356.0, 61.5][c] + r as f64;
            g.value[r][c] = [25.4, -8.1, 140.9][c] * (1.0 - 0.4 * r as f64);
            g.sigma[r][c] = sigma;
            s.observability.states.push(StateStatus {
                name: format!("g{}{}", r + 1, c + 1),
                status: [Status::Observable, Status::Unobservable, Status::Converging][c],
                sigma_ratio: sigma / 360.0,
                sigma,
                target: 40.0,
                unit: "deg/h/g".into(),
            });
        }
    }
    s.observability.unobservable_directions =
        vec![Direction { text: "g12, g22, g32 not at all: needs sideslip".into(), ..Direction::default() }];
    s.observability.disagreement = "Condition (b) is stricter: the turn was too short.".into();
    s.guidance.instruction = "Steep turn right, 55° bank, one circle".into();
    s.guidance.reason = "Loads the vertical axis: shows column z of G.".into();
    s.situation = situation(SituationKind::Maneuver, "Fly now", &s.guidance.instruction, &s.guidance.reason);
    s.guidance.progress = 0.4;
    s.warnings = vec!["RAW_IMU at 99 Hz: another station asks for rates".into()];
    s
}

fn sinks() -> StatusView {
    let status = SinkStatus::new();
    status.set_link(LinkView {
        state: LinkState::Up,
        detail: "udpin:0.0.0.0:14550".into(),
        rate_hz: 168.0,
        lost: 7,
        ..LinkView::default()
    });
    status.set_recorder(RecorderView {
        state: RecorderState::Recording,
        detail: "flight-007.mcap".into(),
        bytes: 2_040_000,
        ..RecorderView::default()
    });
    status.sink("web").dropped(3);
    status.view()
}

fn screen(
    width: u16,
    height: u16,
    snapshot: &Snapshot,
    options: Options,
    over: Over,
) -> Terminal<TestBackend> {
    let events = vec![
        Event {
            elapsed_s: 40.0,
            severity: Severity::Info,
            topic: Topic::State,
            text: "Observable now: g11".into(),
        },
        Event {
            elapsed_s: 61.0,
            severity: Severity::Notice,
            topic: Topic::Instruction,
            text: "Fly: Climb".into(),
        },
    ];
    let sinks = sinks();
    let view = View { snapshot, sinks: &sinks, events: &events, options, over, scroll: 0 };
    let mut terminal = Terminal::new(TestBackend::new(width, height)).unwrap();
    terminal.draw(|frame| draw::draw(frame, &view)).unwrap();
    terminal
}

fn words(terminal: &Terminal<TestBackend>) -> String {
    terminal.backend().to_string()
}

#[test]
fn screens_of_every_size() {
    for (width, height) in [(80, 24), (200, 50), (132, 43), (60, 18), (30, 8)] {
        let terminal = screen(width, height, &flying(), Options::default(), Over::Nothing);
        insta::assert_snapshot!(format!("flying_{width}x{height}"), terminal.backend());
    }
}

#[test]
fn a_console_without_utf8_gets_ascii_only() {
    let options = Options { ascii: true, ..Options::default() };
    let terminal = screen(80, 24, &flying(), options, Over::Nothing);
    let cells: Vec<&str> = terminal.backend().buffer().content().iter().map(|c| c.symbol()).collect();
    assert!(cells.iter().all(|c| c.is_ascii()), "{}", words(&terminal));
    insta::assert_snapshot!("flying_ascii", terminal.backend());
}

#[test]
fn waiting_says_for_what() {
    let text = "no RAW_IMU yet; asked for 100 Hz";
    let situation = situation(SituationKind::Starting, "Waiting for inertial data", text, "");
    let s = Snapshot { waiting_for: text.into(), situation, ..Snapshot::default() };
    let terminal = screen(80, 24, &s, Options::default(), Over::Nothing);
    insta::assert_snapshot!("waiting_80x24", terminal.backend());
}

#[test]
fn help_lies_over_the_screen() {
    let terminal = screen(80, 24, &flying(), Options::default(), Over::Help);
    insta::assert_snapshot!("help_80x24", terminal.backend());
}

#[test]
fn no_size_breaks_it() {
    for width in (1..140).step_by(7) {
        for height in (1..50).step_by(3) {
            for over in [Over::Nothing, Over::Help, Over::Question(Change::Mission)] {
                screen(width, height, &flying(), Options::default(), over);
            }
        }
    }
}

#[test]
fn nonsense_figures_do_not_break_it() {
    let mut s = flying();
    s.guidance.progress = f64::NAN;
    s.observability.conditions.b.progress = -3.0;
    s.observability.states[0].sigma = f64::INFINITY;
    s.observability.states[1].sigma_ratio = 0.0;
    s.estimate.g_sensitivity_deg_per_h_per_g.sigma[0] = [f64::NAN; 3];
    s.consistency.nis_mean_per_dof = f64::NAN;
    assert!(words(&screen(132, 43, &s, Options::default(), Over::Nothing)).contains("Steep turn right"));
}

#[test]
fn a_long_instruction_is_shown_to_its_last_word() {
    let mut s = flying();
    s.guidance.instruction =
        "Wings level at a safe height, full rudder left for five seconds, then right for five \
                              seconds, needed for the g22 column; autopilots do not fly this"
            .into();
    s.situation.text.clone_from(&s.guidance.instruction);
    for (width, height) in [(80, 24), (60, 18), (44, 12), (40, 10)] {
        let shown = words(&screen(width, height, &s, Options::default(), Over::Nothing));
        for word in s.guidance.instruction.split(' ') {
            assert!(shown.contains(word), "{word} is missing at {width}x{height}:\n{shown}");
        }
    }
}

/// Everything on the screen in one line, without borders.
fn sentences(terminal: &Terminal<TestBackend>) -> String {
    let text = words(terminal).replace(|c: char| "│|\"".contains(c), " ");
    text.split_whitespace().collect::<Vec<_>>().join(" ")
}

#[test]
fn every_message_is_there_to_its_last_word_by_scrolling() {
    let mut s = flying();
    s.warnings = (0..6)
        .map(|k| format!("warning {k} of a link that loses frames, told in a sentence that is longer than one line of eighty columns"))
        .collect();
    let shown: String = (0..20)
        .map(|scroll| {
            let (sinks, events) = (sinks(), []);
            let view = View {
                snapshot: &s,
                sinks: &sinks,
                events: &events,
                options: Options::default(),
                over: Over::Nothing,
                scroll,
            };
            let mut terminal = Terminal::new(TestBackend::new(80, 24)).unwrap();
            terminal.draw(|frame| draw::draw(frame, &view)).unwrap();
            sentences(&terminal)
        })
        .collect();
    for said in s.warnings.iter().chain([&s.observability.unobservable_directions[0].text]) {
        assert!(shown.contains(said.as_str()), "{said}");
    }
    assert!(!shown.contains("..."), "nothing is truncated");
}

#[test]
fn who_flies_and_a_dead_link_are_said_in_the_largest_box() {
    use crate::sinks::status::VehicleView;
    let draw_with = |status: &StatusView, s: &Snapshot| {
        let view = View {
            snapshot: s,
            sinks: status,
            events: &[],
            options: Options::default(),
            over: Over::Nothing,
            scroll: 0,
        };
        let mut terminal = Terminal::new(TestBackend::new(80, 24)).unwrap();
        terminal.draw(|frame| draw::draw(frame, &view)).unwrap();
        sentences(&terminal)
    };
    let mut status = sinks();
    status.vehicle = VehicleView {
        control: Control::Autopilot,
        now: "steep turn left".into(),
        maneuver: 3,
        maneuvers: 10,
        duration_s: 40.0,
        left_s: Some(33.2),
        next: "climb".into(),
        ..VehicleView::default()
    };
    let mut auto = flying();
    auto.situation = situation(SituationKind::Mission, "Autopilot flies", "Mission item 12", "");
    let shown = draw_with(&status, &auto);
    assert!(shown.contains("AUTOPILOT FLIES") && shown.contains("3 of 10: steep turn left"), "{shown}");
    assert!(shown.contains("34 s left; next: climb") && !shown.contains("FLY NOW"), "{shown}");
    // Two counts: the way there, and the maneuver.
    (status.vehicle.transit_left_s, status.vehicle.left_s) = (Some(30.2), None);
    let shown = draw_with(&status, &auto);
    assert!(shown.contains("begins in 31 s, then takes 40 s; next") && !shown.contains("s left"), "{shown}");
    status.link.state = LinkState::Silent;
    let shown = draw_with(&status, &auto);
    assert!(shown.contains("NO DATA") && !shown.contains("AUTOPILOT FLIES"), "{shown}");
    let mut done = flying();
    done.guidance.done = true;
    done.situation = situation(SituationKind::Done, "Done", "Land", "Then: gaware report");
    status.link.state = LinkState::Up;
    let shown = draw_with(&status, &done);
    assert!(shown.contains("DONE") && shown.contains("Land") && shown.contains("gaware report"), "{shown}");
}

#[test]
fn no_color_means_none() {
    let colored = |color| {
        let terminal = screen(80, 24, &flying(), Options { color, ..Options::default() }, Over::Nothing);
        terminal.backend().buffer().content().iter().filter(|c| c.fg != Color::Reset).count()
    };
    assert!(colored(true) > 100);
    assert_eq!(colored(false), 0);
}

#[test]
fn the_environment_decides_on_colours_and_letters() {
    let of = |vars: &[(&str, &str)]| {
        Options::from_env(|name| vars.iter().find(|(n, _)| *n == name).map(|(_, v)| (*v).to_owned()))
    };
    let plain = of(&[("LANG", "en_US.UTF-8")]);
    assert!(plain.color && !plain.ascii);
    assert!(!of(&[("NO_COLOR", "1"), ("LANG", "C.utf8")]).color);
    assert!(of(&[("NO_COLOR", "")]).color);
    assert!(of(&[("LC_ALL", "C"), ("LANG", "en_US.UTF-8")]).ascii);
    assert!(of(&[("TERM", "dumb"), ("LANG", "C.UTF-8")]).ascii);
    assert!(of(&[("TERM", "vt220")]).redraw > plain.redraw);
}

/// Keys in their order, one after each frame; then the keyboard breaks.
struct Script(VecDeque<Key>);

impl Keys for Script {
    fn next(&mut self, _wait: Duration) -> io::Result<Option<Key>> {
        self.0.pop_front().map_or_else(|| Err(io::Error::other("no more keys")), |k| Ok(Some(k)))
    }
}

fn play(keys: &[Key]) -> (Terminal<TestBackend>, Result<(), TerminalError>, CancellationToken) {
    play_with(keys, SinkStatus::new(), None)
}

fn play_with(
    keys: &[Key],
    status: Arc<SinkStatus>,
    requests: Option<mpsc::Sender<Request>>,
) -> (Terminal<TestBackend>, Result<(), TerminalError>, CancellationToken) {
    let (_tx, snapshots) = watch::channel(Arc::new(flying()));
    let mut script = Script(keys.iter().copied().collect());
    let mut terminal = Terminal::new(TestBackend::new(80, 24)).unwrap();
    let shutdown = CancellationToken::new();
    let sources = Sources { snapshots, status, requests };
    let options = Options { redraw: Duration::ZERO, ..Options::default() };
    let result = run(&mut terminal, &mut script, sources, options, &shutdown);
    (terminal, result, shutdown)
}

#[test]
fn q_ends_the_program_and_the_question_mark_helps() {
    let (terminal, result, shutdown) = play(&[Key::Help, Key::Quit]);
    result.unwrap();
    assert!(shutdown.is_cancelled());
    assert!(words(&terminal).contains("this help"));
    let (terminal, ..) = play(&[Key::Help, Key::Back, Key::Quit]);
    assert!(!words(&terminal).contains("this help"));
}

fn with_mission(state: MissionState, text: &str) -> Arc<SinkStatus> {
    let status = SinkStatus::new();
    status.set_mission(MissionView { state, name: "excite.plan".into(), items: 12, text: text.into() });
    status
}

#[test]
fn an_upload_is_asked_for_by_two_keys_in_order_only() {
    use Key::{Back, Quit, Yes};
    const UPLOAD: Key = Key::Ask(Change::Mission);
    let asks = |keys: &[Key], state| {
        let (requests, mut asked) = mpsc::channel(1);
        play_with(keys, with_mission(state, "12 items ready"), Some(requests)).1.unwrap();
        asked.try_recv().is_ok()
    };
    assert!(asks(&[UPLOAD, Yes, Quit], MissionState::Ready));
    assert!(asks(&[UPLOAD, Yes, Quit], MissionState::NotOnVehicle), "again after a failure");
    assert!(!asks(&[Yes, Quit], MissionState::Ready), "nobody was asked");
    assert!(!asks(&[UPLOAD, Back, Yes, Quit], MissionState::Ready), "the answer was no");
    assert!(!asks(&[UPLOAD, Yes, Quit], MissionState::Uploading), "one at a time");
    assert!(!asks(&[UPLOAD, Yes, Quit], MissionState::None));
}

#[test]
fn the_question_names_the_mission_and_the_keys() {
    let (requests, _asked) = mpsc::channel(1);
    let status = with_mission(MissionState::Ready, "12 items of excite.plan are ready");
    let (terminal, ..) =
        play_with(&[Key::Ask(Change::Mission), Key::Resized, Key::Quit], status, Some(requests));
    insta::assert_snapshot!("question_80x24", terminal.backend());
}

#[test]
fn parameters_are_set_by_two_keys_after_a_question_that_names_their_values() {
    use Key::{Back, Quit, Resized, Yes};
    const SET: Key = Key::Ask(Change::Parameters);
    let play = |keys: &[Key], state| {
        let (requests, mut asked) = mpsc::channel(1);
        let status = SinkStatus::new();
        status.set_parameters(ParametersView {
            state,
            name: "autopilot.param".into(),
            values: (0..8).map(|k| format!("GPS{k}_DELAY_MS {}", 210 + k)).collect(),
            text: "8 parameters of autopilot.param are ready".into(),
        });
        let (terminal, ended, _) = play_with(keys, status, Some(requests));
        ended.unwrap();
        (terminal, asked.try_recv().ok().map(|r| r.change))
    };
    assert_eq!(play(&[SET, Yes, Quit], MissionState::Ready).1, Some(Change::Parameters));
    assert_eq!(play(&[SET, Back, Yes, Quit], MissionState::Ready).1, None);
    assert_eq!(play(&[SET, Yes, Quit], MissionState::Uploading).1, None);
    assert_eq!(play(&[Key::Ask(Change::Mission), Yes, Quit], MissionState::Ready).1, None, "no mission");
    let (terminal, _) = play(&[SET, Resized, Quit], MissionState::Ready);
    insta::assert_snapshot!("parameters_question_80x24", terminal.backend());
}

#[test]
fn what_became_of_the_mission_comes_first() {
    let shown = |state, text: &str| {
        let (terminal, ..) = play_with(&[Key::Resized, Key::Quit], with_mission(state, text), None);
        words(&terminal)
    };
    assert!(shown(MissionState::Unknown, "UNKNOWN MISSION ON THE VEHICLE").contains("! mission: UNKNOWN"));
    assert!(shown(MissionState::OnVehicle, "is on the vehicle").contains("= mission: is on the vehicle"));
    assert!(!shown(MissionState::None, "").contains("mission:"));
}

#[test]
fn a_broken_keyboard_ends_the_screen_but_not_the_program() {
    let (_, result, shutdown) = play(&[]);
    assert!(result.is_err());
    assert!(!shutdown.is_cancelled());
}

#[test]
fn the_keyboard_is_understood() {
    let key = |code, modifiers| meaning(KeyEvent::new(code, modifiers));
    assert_eq!(key(KeyCode::Char('c'), KeyModifiers::CONTROL), Some(Key::Quit));
    assert_eq!(key(KeyCode::Char('c'), KeyModifiers::NONE), None);
    assert_eq!(key(KeyCode::Char('q'), KeyModifiers::NONE), Some(Key::Quit));
    assert_eq!(key(KeyCode::Char('?'), KeyModifiers::SHIFT), Some(Key::Help));
    assert_eq!(key(KeyCode::Char('u'), KeyModifiers::NONE), Some(Key::Ask(Change::Mission)));
    assert_eq!(key(KeyCode::Char('y'), KeyModifiers::NONE), Some(Key::Yes));
    assert_eq!(key(KeyCode::Char('n'), KeyModifiers::NONE), Some(Key::Back));
    assert_eq!(key(KeyCode::Down, KeyModifiers::NONE), Some(Key::Scroll(1)));
    assert_eq!(key(KeyCode::PageUp, KeyModifiers::NONE), Some(Key::Scroll(-5)));
    assert_eq!(key(KeyCode::Enter, KeyModifiers::NONE), None);
}

#[test]
fn the_headless_line_carries_what_a_log_needs() {
    let line = headless::line(&flying(), &sinks());
    assert_eq!(
        line,
        "1:02:03 running; fly now: Steep turn right, 55° bank, one circle 40%; pilot flies (FBWA); link up; \
         imu 100 Hz; fixes 5.0 Hz; nis 1.08; 3 of 9 parameters converged; rec 2.0 MB; 3 skipped; \
         warning: RAW_IMU at 99 Hz: another station asks for rates"
    );
}

#[tokio::test(start_paused = true)]
async fn headless_writes_a_line_per_period_and_ends_with_the_shutdown() {
    use tokio::io::{AsyncBufReadExt, BufReader};
    let (_tx, snapshots) = watch::channel(Arc::new(flying()));
    let (out, seen) = tokio::io::duplex(64);
    let shutdown = CancellationToken::new();
    let sources = Sources { snapshots, status: SinkStatus::new(), requests: None };
    let task = tokio::spawn(headless::run(sources, headless::PERIOD, out, shutdown.clone()));
    let mut lines = BufReader::new(seen).lines();
    for _ in 0..3 {
        assert!(lines.next_line().await.unwrap().unwrap().starts_with("1:02:03 running"));
    }
    // No one reads any more: the line under way is given up.
    shutdown.cancel();
    task.await.unwrap().unwrap();
}
