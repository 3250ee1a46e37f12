use super::*;
use crate::math::sin_cos;

const NOISE: f64 = 2e-8;

/// Stands on a side for so long, or turns toward it at this rate, rad/s.
fn play(session: &mut Session, t_s: &mut f64, side: Side, for_s: f64, rate: Vector3<f64>) {
    let end = *t_s + for_s;
    let began = *t_s;
    while *t_s < end {
        let turning = rate.norm() > 0.0;
        let force = if turning { Vector3::new(5.0, 5.0, -5.0) } else { side.force() * STANDARD_GRAVITY };
        let stationary = !turning && *t_s - began > 5.0;
        session.look(&Look {
            t_s: *t_s,
            force,
            rate,
            stationary,
            noise: NOISE,
            g_sigma_deg_per_h_per_g: 10.0,
            turn_sigma: [0.0; 3],
        });
        *t_s += 0.1;
    }
}

fn turn(session: &mut Session, t_s: &mut f64, axis: usize) {
    play(session, t_s, Side::Level, 3.0, Vector3::ith(axis, 0.8));
}

#[test]
fn sides_are_recognised_within_twenty_degrees_and_not_beyond() {
    for side in Side::ALL {
        for (degrees, wanted) in [(0.0, true), (18.0, true), (24.0, false)] {
            let f64_degrees: f64 = degrees;
            let across = if side.force().x.abs() > 0.5 { Vector3::y() } else { Vector3::x() };
            let (sin, cos) = sin_cos(f64_degrees.to_radians());
            let force = (side.force() * cos + across * sin) * STANDARD_GRAVITY;
            assert_eq!(Side::of_force(&force) == Some(side), wanted, "{side:?} {degrees}");
        }
    }
    assert_eq!(Side::of_force(&Vector3::new(0.0, 0.0, -14.0)), None);
}

/// Somebody who does what is asked for, with a unit of which four quarter turns about an axis, measured at both ends, show enough.
struct Obedient {
    session: Session,
    t_s: f64,
    at: Side,
    asked: Vec<Instruction>,
    quarters: [u32; 3],
    enough: u32,
}

impl Obedient {
    fn new(enough: u32, skip: &[Side]) -> Self {
        let mut session = Session::default();
        skip.iter().for_each(|side| session.skip(*side));
        Self { session, t_s: 0.0, at: Side::Level, asked: Vec::new(), quarters: [0; 3], enough }
    }

    fn look(&mut self, force: Vector3<f64>, rate: Vector3<f64>, stationary: bool) -> Instruction {
        let turn_sigma = self.quarters.map(|n| if n < self.enough { 2.0 } else { 0.5 });
        let (t_s, g_sigma_deg_per_h_per_g) = (self.t_s, 10.0);
        self.t_s += 0.1;
        self.session.look(&Look {
            t_s,
            force,
            rate,
            stationary,
            noise: NOISE,
            g_sigma_deg_per_h_per_g,
            turn_sigma,
        });
        self.session.instruction()
    }

    /// Still on the side where it is until another is asked for.
    fn hold(&mut self) -> Instruction {
        let began_s = self.t_s;
        loop {
            let asked =
                self.look(self.at.force() * STANDARD_GRAVITY, Vector3::zeros(), self.t_s > began_s + 5.0);
            assert!(self.t_s < began_s + 60.0, "{asked:?}");
            if !matches!(asked, Instruction::Hold { .. }) {
                self.asked.push(asked);
                return asked;
            }
        }
    }

    /// By a quarter, or half, turn to a side.
    fn turn_to(&mut self, side: Side) {
        let (from, to) = (self.at.force(), side.force());
        let about = to.cross(&from);
        let (axis, angle) = match about.norm() > 0.5 {
            true => (about, 1.5),
            false => (Vector3::ith(usize::from(from.x.abs() > 0.5), 1.0), 3.1),
        };
        for _ in 0..(angle / 0.08) as u32 {
            self.look(Vector3::new(5.0, 5.0, -5.0), axis * 0.8, false);
        }
        let axis = axis.iamax();
        self.quarters[axis] += (angle / 1.5) as u32;
        self.at = side;
    }

    fn go_on(&mut self) {
        loop {
            match self.hold() {
                Instruction::Done => return,
                Instruction::Turn { side } | Instruction::TurnAbout { side, .. } => self.turn_to(side),
                Instruction::AlreadyDone { next, .. } => self.turn_to(next),
                other => panic!("{other:?}"),
            }
            assert!(self.t_s < 1200.0, "{:?}", self.asked);
        }
    }
}

#[test]
fn while_scale_and_axes_are_wide_the_sides_come_by_quarter_turns_once_around_each_axis() {
    let mut hands = Obedient::new(4, &[]);
    hands.go_on();
    use Side::{LeftSide, Level, NoseDown, NoseUp, RightSide, UpsideDown};
    let about = |axis: usize, sides: [Side; 4]| sides.map(|side| Instruction::TurnAbout { axis, side });
    let wanted = [
        about(1, [NoseUp, UpsideDown, NoseDown, Level]).to_vec(),
        about(0, [RightSide, UpsideDown, LeftSide, Level]).to_vec(),
        vec![Instruction::Turn { side: NoseUp }],
        about(2, [RightSide, NoseDown, LeftSide, NoseUp]).to_vec(),
        vec![Instruction::Done],
    ];
    assert_eq!(hands.asked, wanted.concat());
    assert!(hands.session.sides().iter().all(|s| s.done));
    // Each side at least twice, half of its time each.
    assert!(hands.t_s < 400.0, "{}", hands.t_s);
}

#[test]
fn turns_that_bring_nothing_are_asked_for_once_around() {
    let mut hands = Obedient::new(1000, &[]);
    hands.go_on();
    let of = |k: usize| {
        hands.asked.iter().filter(|i| matches!(i, Instruction::TurnAbout { axis, .. } if *axis == k)).count()
    };
    assert!([0, 1, 2].into_iter().all(|k| of(k) == 4), "{:?}", hands.asked);
    assert!(hands.session.is_done());
}

#[test]
fn a_vehicle_that_cannot_lie_on_its_back_is_turned_to_and_fro() {
    let mut hands = Obedient::new(4, &[Side::UpsideDown]);
    hands.go_on();
    let to = |i: &Instruction| {
        matches!(
            i,
            Instruction::TurnAbout { side: Side::UpsideDown, .. }
                | Instruction::Turn { side: Side::UpsideDown }
        )
    };
    assert!(!hands.asked.iter().any(to) && hands.quarters.iter().all(|n| *n >= 4), "{:?}", hands.asked);
    assert!(hands.session.is_done());
}

#[test]
fn six_sides_in_any_order_end_it_where_no_turn_is_wanted() {
    let (mut session, mut t_s) = (Session::default(), 0.0);
    for (n, k) in [3, 0, 5, 1, 4, 2].into_iter().enumerate() {
        assert!(!session.is_done());
        play(&mut session, &mut t_s, Side::ALL[k], 60.0, Vector3::zeros());
        assert!(session.sides()[k].done, "{k}");
        turn(&mut session, &mut t_s, n % 2);
    }
    assert!(session.is_done());
}

#[test]
fn a_side_that_is_done_is_not_asked_for_again() {
    let (mut session, mut t_s) = (Session::default(), 0.0);
    play(&mut session, &mut t_s, Side::Level, 60.0, Vector3::zeros());
    let Instruction::AlreadyDone { side, next } = session.instruction() else {
        panic!("{:?}", session.instruction())
    };
    assert_eq!((side, next), (Side::Level, Side::NoseUp));
}

#[test]
fn seconds_left_follow_the_noise_and_not_the_clock() {
    let (quiet, loud) = (Session::wanted_s(2.5e-9), Session::wanted_s(2e-8));
    assert!(quiet < loud && quiet >= HOLD_S.0 && loud <= HOLD_S.1, "{quiet} {loud}");
    let (mut session, mut t_s) = (Session::default(), 0.0);
    play(&mut session, &mut t_s, Side::NoseUp, 10.0, Vector3::zeros());
    let Instruction::Hold { side, seconds_left } = session.instruction() else {
        panic!("{:?}", session.instruction())
    };
    assert_eq!(side, Side::NoseUp);
    assert!((seconds_left - (Session::wanted_s(NOISE) - 5.0)).abs() < 0.3, "{seconds_left}");
}

#[test]
fn hands_that_shake_are_told_and_an_interruption_keeps_what_there_is() {
    let (mut session, mut t_s) = (Session::default(), 0.0);
    let shaky = |session: &mut Session, t_s: &mut f64| {
        for _ in 0..120 {
            let force = Side::NoseDown.force() * STANDARD_GRAVITY;
            let rate = Vector3::new(0.05, 0.0, 0.0);
            let look = Look {
                t_s: *t_s,
                force,
                rate,
                stationary: false,
                noise: NOISE,
                g_sigma_deg_per_h_per_g: 10.0,
                turn_sigma: [0.0; 3],
            };
            session.look(&look);
            *t_s += 0.1;
        }
    };
    shaky(&mut session, &mut t_s);
    assert_eq!(session.instruction(), Instruction::TooMuchMotion { side: Side::NoseDown });
    play(&mut session, &mut t_s, Side::NoseDown, 10.0, Vector3::zeros());
    turn(&mut session, &mut t_s, 1);
    let held_s = session.sides()[2].held_s;
    assert!(held_s > 4.0 && !session.sides()[2].done && session.interruptions() == 1);
    t_s += 30.0;
    play(&mut session, &mut t_s, Side::NoseDown, 60.0, Vector3::zeros());
    assert!(session.sides()[2].done);
}

/// The noise that is measured grows with the turn that begins, and with it the time that a side would want.
#[test]
fn a_turn_that_was_asked_for_is_no_motion_of_the_side_before() {
    let (mut session, mut t_s) = (Session::default(), 0.0);
    play(&mut session, &mut t_s, Side::Level, 60.0, Vector3::zeros());
    let asked = session.instruction();
    assert!(matches!(asked, Instruction::AlreadyDone { next: Side::NoseUp, .. }), "{asked:?}");
    for _ in 0..50 {
        session.look(&Look {
            t_s,
            force: Side::Level.force() * STANDARD_GRAVITY,
            rate: Vector3::new(0.0, 0.2, 0.0),
            stationary: false,
            noise: 1e3 * NOISE,
            g_sigma_deg_per_h_per_g: 10.0,
            turn_sigma: [0.0; 3],
        });
        assert_eq!(session.instruction(), asked, "{t_s}");
        t_s += 0.1;
    }
}

#[test]
fn a_vehicle_that_cannot_lie_on_its_back_is_done_without() {
    let (mut session, mut t_s) = (Session::default(), 0.0);
    session.skip(Side::UpsideDown);
    for side in &Side::ALL[..5] {
        play(&mut session, &mut t_s, *side, 60.0, Vector3::zeros());
        (0..3).for_each(|k| turn(&mut session, &mut t_s, k));
    }
    play(&mut session, &mut t_s, Side::Level, 8.0, Vector3::zeros());
    assert!(session.is_done(), "{:?}", session.instruction());
}
